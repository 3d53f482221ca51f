/* Serial chains of revolute joints, T = A0 Rz(q1) A1 Rz(q2) ... Rz(qn) An.
 *
 * A motion is its three upper rows, twelve numbers, row by row; placements A are n + 1 of them, one after the other. */
#ifndef KR_CHAIN_H
#define KR_CHAIN_H

#include <math.h>

#define KR_PI 3.14159265358979323846
#define KR_TURN (2.0 * KR_PI)
#define KR_MAX_JOINTS 8

/* An angle in [-pi, pi] [rad]. */
static inline double kr_wrapped(double angle) {
    return -KR_PI <= angle && angle <= KR_PI ? angle : angle - KR_TURN * rint(angle / KR_TURN);
}

/* Product of two motions. */
void kr_times(const double a[12], const double b[12], double product[12]);

/* Frames of the joints after their turns, and of the tip: n + 1 motions. */
void kr_frames(int n, const double *A, const double *q, double *F);

/* Geometric Jacobian from `kr_frames`, 6 rows of n, along the base's axes, linear rows first. */
void kr_jacobian_of(int n, const double *F, double *J);

/* Twist (6,) from a pose to another: position [m], sine of the angle times its axis, longer than 1 beyond a right
 * angle. Returns the larger of both parts' lengths. */
double kr_twist_to(const double reached[12], const double T[12], double twist[6]);

/* Distance [m] and angle [rad] between two poses; exact also where the angle is tiny. */
void kr_pose_error(const double a[12], const double b[12], double error[2]);

/* Solve A x = b by elimination with row pivoting: A (n, n) and b (n, m) in rows; b becomes x. Returns the least pivot;
 * at 0 b is not solved. */
double kr_solve(int n, int m, double *A, double *b);

/* The posture equal to q modulo full turns that is nearest to a seed within limits widened by a slack [rad]; returns 0
 * where a joint has no such turn. */
int kr_wound(int n, const double *q, const double *seed, const double *lower, const double *upper, double slack,
             double *found);

#endif
