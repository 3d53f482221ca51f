/* The arctangent of two arguments, inlined: off by up to 2.5 units in the last place, in half of the library's time.
 *
 * The smaller of |y| and |x| is divided by the larger. Beyond tan(pi/8) the angle is taken from pi/4 instead. What is
 * left is Cephes's rational function (S. L. Moshier, Methods and Programs for Mathematical Functions, 1989). */
#ifndef KR_ARCTANGENT_H
#define KR_ARCTANGENT_H

#include <math.h>

static inline double kr_atan2(double y, double x) {
    const double ax = fabs(x), ay = fabs(y), large = ax > ay ? ax : ay, small = ax > ay ? ay : ax;
    const int far = small > 0.41421356237309504880 * large;
    const double above = far ? small - large : small, below = far ? small + large : large;
    const double t = below == 0.0 ? 0.0 : above / below, z = t * t;
    const double p = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z -
                      1.228866684490136173410e2) * z - 6.485021904942025371773e1;
    const double q = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z +
                      4.853903996359136964868e2) * z + 1.945506571482613964425e2;
    double angle = t + t * (z * p / q);
    /* the constants' own rounding is added: pi/4, pi/2 and pi to twice the digits */
    if (far) angle = (angle + 3.061616997868382943e-17) + 0.78539816339744830962;
    if (ay > ax) angle = 1.57079632679489661923 - (angle - 6.123233995736765886e-17);
    if (signbit(x)) angle = 3.14159265358979323846 - (angle - 1.2246467991473531772e-16);
    return copysign(angle, y);
}

#endif
