"""Where the cost of one among many stops falling, and why: what profiles of the growth suite said."""

POSES = """\
Batches of random poses, all eight branches (`UR5Kinematics.batch`), EAIK's `IK_batched` on one thread beside it, and
forward kinematics of as many postures. Memory is the most that a fresh process held that did it once, its inputs
included.

Profiles (`perf record`) say what bounds the cost. A batch of one is 54 % numpy's machinery for calls on arrays of one
element and 34 % the interpreter: single poses have a path of their own, `all_solutions`. At 10 000 poses arithmetic is
what remains: three quarters of the samples are numpy's loops, of which atan2 is the largest single one (18 % of all);
the formulas run over blocks of 4096 poses, whose numbers stay in the second-level cache. Beyond 100 000 poses a pose
costs more again: its eight branches of six angles are 384 bytes that are written once, and at a million 42 % of the
samples are the kernel clearing the pages of the result. Inverse kinematics is then bound by memory, not by arithmetic;
forward kinematics, with less arithmetic to 128 bytes, is from 10 000 on (a third of the samples are the kernel's)."""

ENVIRONMENTS = """\
Steps of `kinreach/UR5SingleStep-v0` with the kinematic backend; each is a whole episode, its reset included. Memory is
that of a fresh process after a reset and a step.

Profiles (`perf record`, `cProfile`): one environment is the interpreter (42 %) and numpy's machinery for calls (37 %),
some hundreds of microseconds whatever the number, which is shared out until about 4096 environments; then numpy's
loops are what counts (45 %). Beyond 16 384 a step stops getting cheaper: its arrays are then so large that they come
fresh from the kernel each time (a fifth of the samples clear pages and serve faults). Seeding is not part of the step:
it takes some 50 us for each environment, once. Of the memory of an environment (some 9 kB) two thirds are goals
that are drawn ahead, 256 of them, and most of the rest its two generators (`tracemalloc`)."""

DYNAMICS = """\
Episodes under full dynamics, as in the suite `env`, in batches on one thread and on two.

What a batch costs besides MuJoCo's step, the Python that plans the moves and looks whether joints have arrived, hardly
grows with the number. With 256 simulations the step is 90 % of the time (`cProfile`, random actions), and MuJoCo steps
each by itself: more of them bring nothing. Two threads share the step, not the other tenth, so they stay below the
double. `cores` says how much of two cores there was."""
