/* Newton's method on an arm with six revolute joints. Poses are their three upper rows, twelve numbers. */
#ifndef KR_NEWTON_H
#define KR_NEWTON_H

/* A posture reaches its pose if it misses it by less [m, rad]. */
#define KR_EXACT 1e-10

/* Newton's method from a posture q to a pose, in place; returns by how much q then misses it [m, rad], NaN included. */
double kr_newton(const double A[84], const double T[12], int steps, double q[6]);

/* The same by damped least squares, for singular postures and bad starts; q becomes the best posture on the way. */
double kr_damped_newton(const double A[84], const double T[12], int steps, double q[6]);

/* By how much a posture misses a pose [m, rad]. */
double kr_missed(const double A[84], const double T[12], const double q[6]);

/* Smallest singular value of the Jacobian at a posture, to the root of rounding. */
double kr_least_singular_value(const double A[84], const double q[6]);

#endif
