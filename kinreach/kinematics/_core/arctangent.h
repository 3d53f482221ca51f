/* The arctangent of two arguments, inlined: off by up to 2.5 units in the last place, in half of the library's time,
 * and without a branch.
 *
 * The smaller of |y| and |x| is divided by the larger. Beyond tan(pi/8) the angle is taken from pi/4 instead. What is
 * left is Cephes's rational function (S. L. Moshier, Methods and Programs for Mathematical Functions, 1989). */
#ifndef KR_ARCTANGENT_H
#define KR_ARCTANGENT_H

#include <math.h>

static inline double kr_atan2(double y, double x) {
    const double ax = fabs(x), ay = fabs(y), large = ax > ay ? ax : ay, small = ax > ay ? ay : ax;
    const double far = small > 0.41421356237309504880 * large ? 1.0 : 0.0;
    const double above = small - far * large, below = large + far * small;
    const double t = above / (below == 0.0 ? 1.0 : below), z = t * t;
    const double p = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z -
                      1.228866684490136173410e2) * z - 6.485021904942025371773e1;
    const double q = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z +
                      4.853903996359136964868e2) * z + 1.945506571482613964425e2;
    /* the constants' own rounding is added: pi/4, pi/2 and pi to twice the digits */
    const double acute = ((t + t * (z * p / q)) + far * 3.061616997868382943e-17) + far * 0.78539816339744830962;
    const double right = ay > ax ? 1.57079632679489661923 - (acute - 6.123233995736765886e-17) : acute;
    const double turned = x < 0.0 ? 3.14159265358979323846 - (right - 1.2246467991473531772e-16) : right;
    return copysign(turned, y);
}

/* The same for `count` pairs, which the compiler takes two or more at a time. */
static inline void kr_atan2_of_each(int count, const double *restrict y, const double *restrict x, double *restrict angle) {
    for (int i = 0; i < count; i++) angle[i] = kr_atan2(y[i], x[i]);
}

#endif
