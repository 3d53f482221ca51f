"""Where the cost of one among many stops falling, and why: what a run says of it, and what profiles said."""

from benchmarks.speed.suites import PROFILED

POSES = """\
Batches of random poses, all eight branches (`UR5Kinematics.batch`), EAIK's `IK_batched` on one thread beside it (the
suite `ik-batch` also calls EAIK in a loop), and forward kinematics of as many postures. Memory is the most that a fresh
process held that did it once, its inputs included.{blank}

Of these sizes, inverse kinematics is cheapest a pose in batches of {ik}, forward kinematics in batches of {fk}. Both
run over blocks of 4096, whose numbers stay in the second-level cache; the eight branches of six angles of a pose are
384 bytes that are written once, a posture's pose is 128.

{profiled}, by `perf record`: a batch of one was 54 % numpy's machinery for calls on arrays of one element and 34 % the
interpreter; single poses have a path of their own, `all_solutions`. At 10 000 poses arithmetic was what remains: three
quarters of the samples were numpy's loops, of which atan2 was the largest single one (18 % of all). At a million 42 %
of the samples were the kernel clearing the pages of the result: inverse kinematics was then bound by memory, not by
arithmetic. Forward kinematics was from 10 000 on (a third of the samples were the kernel's)."""
BLANK = (
    " EAIK is timed with up to {most} poses: at what it took for one of those, a single call with {largest} would take "
    "{seconds:.2g} s, so its cells are empty beyond."
)

ENVIRONMENTS = """\
Steps of `kinreach/UR5SingleStep-v0` with the kinematic backend; each is a whole episode, its reset included. Memory is
that of a fresh process after a reset and a step.

Of these sizes, a step is cheapest in a batch of {cheapest}. Seeding is not part of the step: the first reset, which
seeds the generators, took {seeding:.3g} us for each of {most} environments, once.{memory}

{profiled}, by `perf record` and `cProfile`: one environment was the interpreter (42 %) and numpy's machinery for calls
(37 %), which a batch shares out; with 4096 environments numpy's loops counted most (45 %). Beyond 16 384 the arrays of
a step were so large that they came fresh from the kernel each time (a fifth of the samples cleared pages and served
faults). Of the memory of an environment two thirds were goals that are drawn ahead, 256 of them, and most of the rest
its two generators (`tracemalloc`)."""
MEMORY = " Each of them takes {kilobytes:.2g} kB of memory."

DYNAMICS = f"""\
Episodes under full dynamics, as in the suite `env`, in batches on one thread and on two.

What a batch costs besides MuJoCo's step, the Python that plans the moves and looks whether joints have arrived, hardly
grows with the number; MuJoCo steps each by itself. Two threads share out the simulations, and not the rest. One
simulation cannot be shared: its row says what noise, and the handing over to threads, do to a ratio that should be 1,
and rows of a few are to be read with that in mind. `cores that two had` says how much of two cores there was.

{PROFILED}: with 256 simulations the step was 90 % of the time (`cProfile`, random actions)."""
