/* Sine and cosine together, inlined: off by up to a unit in the last place, for angles of up to 1e5 rad.
 *
 * The angle is brought within pi/4 of a multiple of pi/2, which is taken off in three parts; the polynomials are Cephes's
 * (S. L. Moshier, Methods and Programs for Mathematical Functions, 1989). */
#ifndef KR_SINCOS_H
#define KR_SINCOS_H

static inline void kr_sincos(double x, double *sine, double *cosine) {
    static const double ROUND = 6755399441055744.0;  /* what is added and taken off again loses its fraction */
    const double n = (x * 0.63661977236758134308 + ROUND) - ROUND, q = n - 4.0 * ((0.25 * n + ROUND) - ROUND);
    const double r = ((x - n * 1.57079625129699707031) - n * 7.54978941586159635336e-8) - n * 5.39030285815811905290e-15;
    const double z = r * r;
    const double s = r + r * z * (((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z +
                                     2.75573136213857245213e-6) * z - 1.98412698295895385996e-4) * z +
                                   8.33333333332211858878e-3) * z - 1.66666666666666307295e-1);
    const double c = 1.0 - 0.5 * z + z * z * (((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z -
                                                2.75573141792967388112e-7) * z + 2.48015872888517045348e-5) * z -
                                              1.38888888888730564116e-3) * z + 4.16666666666665929218e-2);
    const double odd = q * q == 1.0 ? 1.0 : 0.0, even = 1.0 - odd, sign = 1.0 - 0.5 * q * q;  /* quarter turns: -2 to 2 */
    *sine = odd * q * c + even * sign * s;
    *cosine = even * sign * c - odd * q * s;
}

/* The same for `count` angles, which the compiler takes two or more at a time. */
static inline void kr_sincos_of_each(int count, const double *restrict x, double *restrict sine, double *restrict cosine) {
    for (int i = 0; i < count; i++) kr_sincos(x[i], sine + i, cosine + i);
}

#endif
