/* The face of the core: what `kinreach.kinematics` calls. Lines that begin with # are not for cffi, which reads the rest.
 *
 * Numbers in, numbers out: arrays in the order of C, of the sizes that are said here. Angles are in rad, lengths in m.
 * A pose is a homogeneous transform (4, 4) with an exact rotation; frames and placements are the three upper rows (3, 4).
 * A row of postures is branch index, singularity flags, and n angles. Nothing is allocated, and nothing is kept. */
#ifndef KR_CORE_H
#define KR_CORE_H
#ifndef __GNUC__
#error "a compiler with GNU C's attributes is needed: gcc, clang or zig"
#endif
#pragma GCC visibility push(default)

/* An arm as it is given: n joints with limits, T = A0 Rz(q1) A1 ... Rz(qn) An. */
typedef struct {
    int n;
    int full_turn;           /* every joint covers a full turn: principal values are within the limits */
    int one_turn;            /* and no more than that: they are the only ones, the two ends apart */
    double lower[8], upper[8];
    double placements[108];  /* n + 1 of (3, 4) */
} kr_arm;

/* What is asked of the tip, in calls: `kind` is 0 for all of a pose T (its three upper rows are read), 1 for its position
 * and its z axis (columns 4 and 3), 2 for its position. */

/* Whether a pose is a rigid motion to rounding, at most 1e6 m away. */
int kr_is_rigid(const double T[16]);

/* Errors [m, rad] of `count` rows of postures, (count, 2), on the arm as it is given. */
void kr_errors(const kr_arm *arm, int kind, const double *T, const double *rows, int count, double *errors);

/* Postures in the windings that are nearest to a seed, and within the limits where these count; rows that have none are
 * dropped, one barely past a limit is moved into it if it then reaches the goal within `tol`. Without a seed (null)
 * windings are near 0 and the order stays; with one the rows are sorted by their distance from it. Returns how many. */
int kr_within(const kr_arm *arm, int kind, const double *T, const double *seed, int limits, double tol, double *rows,
              int count);

/* The winding of one posture q (n,) that `kr_within` chooses; returns 0 where there is none. */
int kr_allowed(const kr_arm *arm, int kind, const double *T, const double *q, const double *seed, int limits, double tol,
               double *found);

/* An arm of the UR's kind, in its Denavit-Hartenberg frames. */
typedef struct {
    double d1, upper, fore, d4, d5, d6;      /* upper and fore are the lengths of the two links, positive */
    double stretched, folded;                /* from shoulder to wrist_1 with the elbow straight, or folded */
    double base[12], flange[12];             /* from the pose's base to the DH base, and from the tip to the flange */
} kr_ur;

/* Every posture of a pose by the closed form, into rows (8, 8). A free wrist_3 keeps the seed's value as far as it can;
 * with an arm (else null) it gets one with which the posture is within the limits. Returns how many there are; `miss` gets
 * the parts that kept others from reaching. */
int kr_ur_postures(const kr_ur *ur, const kr_arm *arm, const double T[16], const double seed[6], double tol, double *rows,
                   int *miss);

/* Every posture with a point of the tool's axis, `reach` from the flange, at a position, and that axis along a direction
 * (columns 3 and 4 of `T`), into rows (8, 8). A free q234 stays near `pitch`; q6 is given. */
int kr_ur_axis_postures(const kr_ur *ur, const double T[12], double reach, double pitch, double q6, double tol,
                        double *rows, int *miss);

/* Ways to find every posture of a pose; what each needs is prepared once. */
enum kr_way {
    KR_UR                    /* kr_ur: eight branches */
};

/* Every posture of a pose, in windings near a seed (which may be null) and within limits, as `kr_within` has them, into
 * rows (16, 2 + n). Returns how many, or -1 where T is no rigid motion. `found`, if it is not null, gets how many there
 * were before limits, and the parts that missed. */
int kr_solutions(enum kr_way way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                 int limits, double tol, double *rows, int found[2]);

/* The nearest of them: the row first in `rows`, and in the next row its errors [m, rad]. Returns as `kr_solutions`, -1
 * also where the seed has an entry that is not within 1e6. */
int kr_nearest(enum kr_way way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
               double tol, double *rows);

/* `kr_solutions` without a seed for `count` poses: postures (count, branches, n) by branch, NaN where there is none, and
 * which there are. Where a pose is no rigid motion it stops and returns its index, else -1. */
int kr_solutions_of_each(enum kr_way way, const void *prepared, const kr_arm *arm, const double *T, int count, int limits,
                         double tol, int branches, double *q, unsigned char *valid);

/* The nearest posture to each of `count` seeds (count, n), NaN where there is none, and its branch, -1 there. Returns as
 * `kr_solutions_of_each`. */
int kr_nearest_of_each(enum kr_way way, const void *prepared, const kr_arm *arm, const double *T, const double *seeds,
                       int count, double tol, double *q, long long *branch);

#pragma GCC visibility pop
#endif
