/* One posture of an arm with seven joints on the curve of a pose's postures.
 *
 * A has the placements of the joints and of the tip, and behind them for each joint by how much it slides along its axis
 * in a step of 1 [m]; 0 for a joint that turns. */
#ifndef KR_SELF_MOTION_H
#define KR_SELF_MOTION_H

enum { KR_SEVEN = 7, KR_LOOP = 12 * (KR_SEVEN + 1) + KR_SEVEN };

/* Solve M x = b for two right sides b (7, 2), in place; returns the sign of det M, 0 if it is singular. */
int kr_solve_seven(double M[49], double b[14]);

/* Newton's method from q across a direction, in place; returns by how much q misses the pose then at most [m, rad], NaN
 * included. */
double kr_across(const double A[KR_LOOP], const double T[12], const double direction[7], int steps, double q[7]);

/* Unit tangent nearest to a direction at q; returns the sign of det [J; direction], 0 where there is none. */
int kr_tangent_along(const double A[KR_LOOP], const double q[7], const double direction[7], double tangent[7]);

/* `kr_across`, and a unit tangent where it ends, to 1e-6, with its sign, as `kr_tangent_along`. */
double kr_step_along(const double A[KR_LOOP], const double T[12], const double direction[7], int steps, double q[7],
                     double tangent[7], int *sign);

/* Whether a step of Newton's method contracts from a start to a posture q of the pose, across a direction: no other is as
 * near the start. `sign` gets the sign of det [J; direction] at q, 0 where that is singular. */
int kr_contracts(const double A[KR_LOOP], const double T[12], const double direction[7], const double start[7],
                 const double q[7], int *sign);

/* Unit tangent t at q with det [J; t] > 0; returns 0 where there is none. */
int kr_tangent(const double A[KR_LOOP], const double q[7], double tangent[7]);

/* Smallest singular value of the Jacobian, to the root of rounding. */
double kr_least_of_seven(const double A[KR_LOOP], const double q[7]);

#endif
