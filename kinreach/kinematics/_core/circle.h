/* Zeros of a quadratic function of cosine and sine. */
#ifndef KR_CIRCLE_H
#define KR_CIRCLE_H

#include "core.h"

enum { KR_MAX_ROOTS = 8 };

/* An angle [rad], and whether two zeros merge there. */
typedef struct {
    double angle;
    int merged;
} kr_root;

/* Two zeros of an angle, or two postures, that differ by less are one [rad]. */
#define KR_MERGED 1e-6
/* Cosines, and shares of the largest coefficient, below this are 0. */
#define KR_ZERO 1e-12

/* Whether what a closed form finds may be different on an arm whose poses are up to `off` away [m, rad]. */
typedef struct {
    int found;
    double off;
    int free;    /* bits of the joints that took the seed's value */
} kr_doubt;

/* The function below at an angle with this cosine and sine. */
double kr_circle_value(const double k[6], double c, double s);

/* Angles at which k0 + k1 c + k2 s + k3 c c + k4 c s + k5 s s is 0, or almost. Four zeros are in the order of
 * their size, two have the same order all along.
 *
 * `start` is returned where the function is 0 everywhere. Where two zeros merge it may be off by `tol`, in shares of its
 * largest coefficient. `gain` is by how much it changes for one unit that poses are off; `doubt` may be null. */
int kr_circle_roots(const double k[6], double start, double tol, double gain, kr_doubt *doubt,
                    kr_root roots[KR_MAX_ROOTS]);

#endif
