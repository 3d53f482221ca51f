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

/* Six revolute axes, whose postures are found by elimination (`elimination.c`); `kr_elimination_prepare` fills it in. */
typedef struct {
    double placements[84];   /* 7 of (3, 4) */
    double size;             /* unit of length of the equations [m] */
    double near[378];        /* functions of axis 5 from the base: coefficients of joints 2, 3, 4 (14, 3, 3, 3) */
    double left[36];         /* (A0 R1 A1)^-1 at three angles of joint 1 (3, 3, 4) */
    double right[18];        /* third and fourth column of (A5 R6 A6)^-1 at three angles of joint 6 (3, 3, 2) */
    double rest[384];        /* basis (24, 16) of the eigenvalue problem without what is extraneous */
    double constant[256];    /* the part (16, 16) of its matrix that is the same for all poses */
    int spurious_count;      /* eigenvalues that lead to no posture of any pose: */
    double spurious[24];     /* the angles of joint 2 [rad] */
    int singular;            /* the equations are singular for all poses: eigenvalues may be missing */
} kr_elimination;

void kr_elimination_prepare(const double placements[84], kr_elimination *arm);

/* Every posture of `count` poses into q (count, 16, 6), angles in [-pi, pi], and how many each pose has. Where none
 * reaches a pose exactly, those that miss it by at most `tol` [m, rad]. `hard`, if not null, gets 1 for each pose that
 * is singular or almost. A pose that is not finite has no postures. */
void kr_elimination_postures(const kr_elimination *arm, const double *T, int count, double tol, double *q, int *counts,
                             int *hard);

/* Starting points of Newton's method for `count` poses into q, with the imaginary parts of their eigenvalues and the
 * index of the pose; with room for 16 a pose. Imaginary parts are less than `most`. Returns how many there are. */
int kr_elimination_starts(const kr_elimination *arm, const double *T, int count, double most, double *q,
                          double *imaginary, long long *pose);

/* Newton's method on six joints with placements A from `count` postures (count, 6), in place, each to its pose, and by
 * how much they miss then [m, rad]; damped, it keeps the best posture on the way. */
void kr_newton_of_each(const double A[84], const double *T, int count, int steps, int damped, double *q, double *missed);

/* A UR with its calibration (`calibrated.c`). */
typedef struct {
    double base[12], flange[12];             /* from the pose's base to the chain's, and from the tip to the chain's end */
    kr_ur fitted;                            /* the nearest arm with a closed form, of the chain's end in its base */
    double zeros[6];                         /* what its joint angles are more than the arm's [rad] */
    double turned, centre, radius, wrist[2]; /* bounds of the difference between the two */
    kr_elimination elimination;              /* of the chain */
} kr_calibrated;

/* Six revolute axes that decouple (`decoupled.c`): the chain before Z1 X1 Z2 X2 Z3 X3 Z4 X4 Z5 X5 Z6 after, where Zi turns
 * about z by sign_i q_i + offset_i and moves along it by d_i, and Xi moves along x by a_i and turns about it by alpha_i.
 * `kr_decoupled_prepare` fills in what comes after `placements`. */
typedef struct {
    double sign[6], offset[6], d[6], a[5], alpha[5];
    double before[12], after[12];            /* the inverse of both */
    double placements[84];                   /* of the arm as it is given, 7 of (3, 4) */
    double cosine[5], sine[5];               /* of alpha */
    int spherical;                           /* axes 4, 5 and 6 meet; else axes 2, 3 and 4 are parallel */
    int by_shoulder;                         /* joint 1 is found before all others, from two values */
    int right_angles;                        /* of the wrist's axes */
    double upper, fore, fore_angle;          /* lengths of the two links, and the angle of the second one */
    double stretched, folded;                /* how far they reach */
    double height;                           /* of the plane they move in, above that of axes 1 and 2 */
    double hand, hand_angle;                 /* length and angle of what three parallel axes carry */
    double square_of_point[3], height_of_point[3];  /* of a wrist's centre, as functions of joint 3 */
    double size;                             /* the shortest length */
    double length_divisor, sine_divisor;     /* results are divided by them: the smaller, the less exact they are */
} kr_decoupled;

void kr_decoupled_prepare(kr_decoupled *arm);

/* Every posture of `count` poses, as way KR_DECOUPLED has them, by branch, without limits: q (count, 8, 6), NaN where there
 * is none, and which there are. A free joint keeps the value of the pose's seed (count, 6). */
void kr_decoupled_postures_of_each(const kr_decoupled *arm, const double *T, const double *seeds, int count, double tol,
                                   double *q, unsigned char *valid);

/* Rows of the closed form with a tolerance, in which nothing is tried on the arm: with room for 64. `free` gets the joints
 * that are free, as bits; with `samples_too` they also take many values: with room for 107000. Returns how many. */
int kr_decoupled_rows(const kr_decoupled *arm, const double T[12], double tol, const double seed[6], int samples_too,
                      int *free, double *rows);

/* Starting points of Newton's method for `count` poses into q, and the index of the pose, with room for 128 a pose: near
 * its postures, and near some that only just do not exist. Returns how many there are. */
int kr_decoupled_starts(const kr_decoupled *arm, const double *T, int count, double *q, long long *pose);

/* The postures of `count` poses on an arm whose poses are up to `off` from those of one that decouples, by branch: q
 * (count, 16, 6), NaN where there is none, and which there are. A pose is doubtful if it may have others; none is said. */
void kr_nearly_decoupled_of_each(const kr_decoupled *arm, double off, const double *T, const double *seeds, int count,
                                 double *q, unsigned char *valid, unsigned char *doubtful);

/* The first of the postures q (count, 6) of a pose from which the arm moves to each of them while its tip stays. */
void kr_families(const double placements[84], const double T[12], const double *q, int count, int *first);

/* An arm of four or five revolute joints, which brings its tip to a point and turns it as far as it can
 * (`nearest_orientation.c`); `kr_five_axis_prepare` fills it in. */
enum { KR_FIVE_JOINTS = 5, KR_MAX_STATIONARY = 64 };
typedef struct {
    int triple[32][2];       /* for each set of held joints, the threes of the others that reach a point best; 0 if none */
    int last_turns_tip;      /* the last joint turns the tip about its own z axis, and moves it nowhere, or hardly */
    int pitched;             /* axes 2, 3 and 4 are parallel: what follows is in the frame of joint 2, whose z axis is theirs */
    double sense[3];         /* 1 or -1: whether their joints turn about z or against it */
    double upper[2], fore[2];/* from axis 2 to 3 and to 4, with all joints at 0 */
    double tip[3][3];        /* from axis 4 to the tip: constant, and factors of cosine and sine of joint 5 */
    double turn[3][9];       /* orientation of the tip, likewise */
} kr_five_axis;

/* Returns 0 where no three joints reach all points about them: the arm is singular in every posture. */
int kr_five_axis_prepare(const kr_arm *arm, kr_five_axis *five);

/* Postures with the tip at a point at which what is left of its orientation (kind 0) or axis (kind 1) is stationary among
 * all postures with the tip there, and with `limits` those at which it is least for what they allow; the least first, and of
 * the same the nearest to a seed (which may be null). Into rows (64, 2 + n): index, kind (0 minimum, 1 saddle, 2 maximum, 3
 * minimum at a limit), angles in windings near the seed; and into `errors` (64, 2) by how much each misses the point [m], and
 * what it leaves [rad]. Returns how many, or -1 where T is no rigid motion. Of an axis only it and the point are read. */
int kr_nearest_orientations(const kr_five_axis *five, const kr_arm *arm, int kind, const double T[16],
                            const double *seed, int limits, double *rows, double *errors);

/* Ways to find every posture of a pose; what each needs is prepared once. */
enum kr_way {
    KR_UR,                   /* kr_ur: eight branches */
    KR_CALIBRATED,           /* kr_calibrated: eight branches, and eight more near singularities */
    KR_DECOUPLED,            /* kr_decoupled: eight branches */
    KR_ELIMINATION,          /* kr_elimination: up to sixteen, in no order */
    KR_BACKWARDS = 8         /* added: what is prepared is the arm from its tip to its base */
};

/* Every posture of a pose, in windings near a seed (which may be null) and within limits, as `kr_within` has them, into
 * rows (16, 2 + n). Returns how many, or -1 where T is no rigid motion. Where there is none the first two numbers in `rows`
 * are how many there were before limits, and the parts that missed. */
int kr_solutions(int way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                 int limits, double tol, double *rows);

/* The nearest of them: the row first in `rows`, and in the next row its errors [m, rad]. Returns as `kr_solutions`, -1
 * also where the seed has an entry that is not within 1e6. */
int kr_nearest(int way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
               double tol, double *rows);

/* `kr_solutions` without a seed for `count` poses: postures (count, branches, n) by branch, NaN where there is none, and
 * which there are. Where a pose is no rigid motion it stops and returns its index, else -1. */
int kr_solutions_of_each(int way, const void *prepared, const kr_arm *arm, const double *T, int count, int limits,
                         double tol, int branches, double *q, unsigned char *valid);

/* The nearest posture to each of `count` seeds (count, n), NaN where there is none, and its branch, -1 there. Returns as
 * `kr_solutions_of_each`. */
int kr_nearest_of_each(int way, const void *prepared, const kr_arm *arm, const double *T, const double *seeds,
                       int count, double tol, double *q, long long *branch);

/* A base that turns about z and two links that turn about y (`yaw_planar.c`), whose tip has to be at a point. */
typedef struct {
    double base[12];         /* from the points' base to the frame of joint 1 */
    double shoulder[2];      /* axis 2 in the turning frame: x and z */
    double offset;           /* of the tip sideways, along y of the turning frame */
    double upper, upper_angle, fore, fore_angle; /* length of either link, and its angle from z towards x at zero angles */
} kr_yaw_planar;

/* Every posture with the tip at a point, up to four; as `kr_solutions`, of rows (4, 5). */
int kr_yaw_planar_solutions(const kr_yaw_planar *g, const kr_arm *arm, const double p[3], const double *seed, int limits,
                            double tol, double *rows);

/* The same without a seed for `count` points (count, 3), and the nearest to each of `count` seeds; as
 * `kr_solutions_of_each` and `kr_nearest_of_each`. */
void kr_yaw_planar_solutions_of_each(const kr_yaw_planar *g, const kr_arm *arm, const double *p, int count, int limits,
                                     double tol, double *q, unsigned char *valid);
void kr_yaw_planar_nearest_of_each(const kr_yaw_planar *g, const kr_arm *arm, const double *p, const double *seeds,
                                   int count, double tol, double *q, long long *branch);

/* An arm with seven joints has curves of postures for a pose (`self_motion.c`, `tracing.c`); A are its placements, and
 * behind them by how much each joint slides along its axis in a step of 1 [m], 0 if it turns. Slides are within ±pi. T is
 * the pose. A posture misses it by the larger of position [m] and orientation [rad]. */

/* Newton's method from `count` postures (count, 7), in place, by the shortest steps, and by how much they miss then. */
void kr_shortest_steps(const double A[103], const double T[12], int steps, int count, double *q, double *missed);

/* The same across directions (count, 7), which become unit tangents of the curve where it arrives, nearest to them. */
void kr_across_each(const double A[103], const double T[12], int steps, int count, double *q, double *direction,
                    double *missed);

/* Unit tangents (count, 7) at postures of a curve, nearest to directions (count, 7); without these (0) to any. */
void kr_tangents(const double A[103], int count, const double *q, const double *ahead, double *tangents);

/* By how much postures miss the pose. */
void kr_missed_by_each(const double A[103], const double T[12], int count, const double *q, double *missed);

/* Smallest singular values of the Jacobians, to the root of rounding. */
void kr_least_singular_values(const double A[103], int count, const double *q, double *values);

/* All curves through `count` starts (count, 7), which reach the pose, in [-pi, pi], sorted by joint 1. Postures along them
 * without jumps go into `samples`, at most `room` in all, unit tangents into `tangents`; `ends` gets where each curve
 * ends there, `closed` 1 if it comes back to its first posture, 0 if not, and -1 if it is none, both (2, count). Memory for
 * what is found on the way: (4, count). Returns how many curves there are, at most 2 count. */
int kr_self_motion(const double A[103], const double T[12], const double *starts, int count, int room, double *samples,
                   double *tangents, int *ends, int *closed, int *marks);

/* Which of `others` postures (others, 7) of the pose are on a curve with these samples and tangents (count, 7). */
void kr_on_curve(const double A[103], const double T[12], const double *samples, const double *tangents, int count,
                 int closed, const double *q, int others, unsigned char *on);

/* Whole turns by which values of a joint along a curve are wound into limits, shape (count,): each is as near to the one
 * before as the limits allow. Values are `stride` apart. */
void kr_turns_along(int count, int stride, const double *q, double lower, double upper, double slack, double *turns);

/* Where `count` cubics (count, n) from a posture by a way, with derivatives at both ends, come to a limit of a joint that
 * is `limited`: index n * cubic + joint, the limit, and the parameter in [0, 1]. At most 6 a cubic and joint. */
int kr_crossings(int count, int n, const double *begin, const double *away, const double *out, const double *into,
                 const double *lower, const double *upper, const unsigned char *limited, int *which, double *limits,
                 double *shares);

#pragma GCC visibility pop
#endif
