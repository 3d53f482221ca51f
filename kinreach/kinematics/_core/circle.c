/* With t = tan(q / 2) the function is a quartic polynomial, and with z = exp(i q) its zeros are on the unit circle. The
 * angle is counted from where the polynomial's first coefficient is large, so that no zero is at infinity. */
#include "circle.h"

#include "chain.h"
#include "eigenvalues.h"

#include <math.h>

enum { POLISH = 4, ORIGINS = 8 };
/* Zeros are apart by more than this [rad]; how far a complex zero may be off the unit circle to count. */
static const double APART = 1e-6, OFF_CIRCLE = 1e-3;

double kr_circle_value(const double k[6], double x, double y) {
    return k[0] + k[1] * x + k[2] * y + k[3] * x * x + k[4] * x * y + k[5] * y * y;
}

static double slope(const double k[6], double x, double y) {
    return -k[1] * y + k[2] * x + 2.0 * (k[5] - k[3]) * x * y + k[4] * (x * x - y * y);
}

static double bend(const double k[6], double x, double y) {
    return -k[1] * x - k[2] * y + 2.0 * (k[5] - k[3]) * (x * x - y * y) - 4.0 * k[4] * x * y;
}

static int on_a_line(const double k[6], double middle, double size, double largest, double tol, kr_root roots[2]) {
    if (fabs(middle) > size + 2.0 * tol * largest || !(size > 0.0)) return 0;
    const double way = atan2(k[2], k[1]), apart = acos(fmin(1.0, fmax(-1.0, -middle / size)));
    if (apart < KR_MERGED || KR_PI - apart < KR_MERGED) {
        roots[0].angle = apart < KR_MERGED ? way : way + KR_PI, roots[0].merged = 1;
        return 1;
    }
    roots[0].angle = way + apart, roots[1].angle = way - apart;
    roots[0].merged = roots[1].merged = 0;
    return 2;
}

/* The four zeros as z = exp(i q): their angles, and how far they are off the unit circle. Returns how many. */
static int zeros(const double k[6], double angles[4], double off[4]) {
    double phase = 0.0, most = -1.0, a[16] = {0.0}, real[4], imaginary[4];
    for (int i = 0; i < ORIGINS; i++) {
        const double origin = KR_TURN * i / ORIGINS, size = fabs(kr_circle_value(k, -cos(origin), -sin(origin)));
        if (size > most) most = size, phase = origin;
    }
    const double x = cos(phase), y = sin(phase), mean = 0.5 * (k[3] + k[5]), half = 0.5 * (k[3] - k[5]);
    const double c = k[1] * x + k[2] * y, s = k[2] * x - k[1] * y;
    const double even = half * (x * x - y * y) + k[4] * x * y, odd = 0.5 * k[4] * (x * x - y * y) - 2.0 * half * x * y;
    const double one = k[0], cc = mean + even, cs = 2.0 * odd, ss = mean - even, first = one - c + cc;
    if (!(fabs(first) > 0.0)) return 0;
    a[0] = -2.0 * (s - cs) / first, a[1] = -2.0 * (one - cc + 2.0 * ss) / first;
    a[2] = -2.0 * (s + cs) / first, a[3] = -(one + c + cc) / first;
    a[4] = a[9] = a[14] = 1.0;
    if (!kr_eigenvalues(4, a, real, imaginary)) return 0;
    for (int i = 0; i < 4; i++) {
        /* z = (1 + i t) / (1 - i t) */
        const double u = real[i], v = imaginary[i], square = (1.0 + v) * (1.0 + v) + u * u;
        angles[i] = kr_wrapped(phase + atan2(2.0 * u, 1.0 - u * u - v * v));
        off[i] = fabs(sqrt(((1.0 - v) * (1.0 - v) + u * u) / square) - 1.0);
    }
    return 4;
}

static int among(const kr_root *roots, int count, double angle, double distance) {
    for (int i = 0; i < count; i++)
        if (fabs(kr_wrapped(roots[i].angle - angle)) < distance) return i;
    return -1;
}

static int sorted(kr_root *roots, int count) {
    for (int i = 0; i < count; i++) roots[i].angle = kr_wrapped(roots[i].angle);
    for (int i = 1; i < count; i++) {
        const kr_root root = roots[i];
        int at = i;
        for (; at > 0 && roots[at - 1].angle > root.angle; at--) roots[at] = roots[at - 1];
        roots[at] = root;
    }
    return count;
}

int kr_circle_roots(const double k[6], double start, double tol, double gain, kr_doubt *doubt,
                    kr_root roots[KR_MAX_ROOTS]) {
    double largest = 0.0, angles[4], off[4];
    for (int i = 0; i < 6; i++) largest = fmax(largest, fabs(k[i]));
    if (largest < fmax(KR_ZERO, tol)) {
        roots[0].angle = start, roots[0].merged = 1;
        return 1;
    }
    const double fold = doubt ? 2.0 * sqrt(doubt->off * gain / largest) : 0.0;  /* angle between zeros that may meet */
    const double middle = k[0] + 0.5 * (k[3] + k[5]), size = sqrt(k[1] * k[1] + k[2] * k[2]);
    if (hypot(0.25 * (k[3] - k[5]), 0.25 * k[4]) <= KR_ZERO * largest) {
        if (doubt && (size == 0.0 || fabs(1.0 - middle / size * (middle / size)) < fold * fold)) doubt->found = 1;
        return on_a_line(k, middle, size, largest, tol, roots);
    }
    const int count = zeros(k, angles, off);
    const double off_circle = fmax(OFF_CIRCLE, 2.0 * sqrt(tol));
    kr_root steady[4];  /* between two zeros that almost merge */
    int found = 0, middles = 0;
    for (int i = 0; i < count; i++) {
        /* of a pair of complex zeros about the circle one may be just within */
        if (doubt && OFF_CIRCLE < off[i] && off[i] < 2.0 * fold) doubt->found = 1;
        if (!(off[i] <= off_circle)) continue;
        double q = angles[i], gradient = 0.0;
        for (int step = 0; step < (off[i] <= OFF_CIRCLE ? POLISH : 0); step++) {
            const double x = cos(q), y = sin(q);
            gradient = slope(k, x, y);
            if (fabs(gradient) <= KR_ZERO * largest) break;
            q -= kr_circle_value(k, x, y) / gradient;
        }
        int merged = fabs(gradient) < KR_MERGED * largest;
        if (!(fabs(q - angles[i]) <= APART + 10.0 * off[i])) q = angles[i], merged = 1;  /* only a complex one is nearby */
        const int near = among(roots, found, q, APART);
        if (merged || near >= 0) {  /* between the two the function is steady */
            int step = 0;
            for (; step < POLISH; step++) {
                const double x = cos(q), y = sin(q), gradient_there = slope(k, x, y), curvature = bend(k, x, y);
                if (!(fabs(gradient_there) < fabs(curvature) * off_circle)) break;
                q -= gradient_there / curvature;
            }
            if (step == POLISH) {
                const double x = cos(q), y = sin(q), off_zero = kr_circle_value(k, x, y);
                const double apart = sqrt(fmax(0.0, -2.0 * off_zero / bend(k, x, y)));
                if (apart > KR_MERGED) {
                    const int known = among(steady, middles, q, APART) >= 0;
                    steady[middles++].angle = q;
                    if (!known && found + 2 <= KR_MAX_ROOTS) {
                        roots[found].angle = q + apart, roots[found++].merged = 0;
                        roots[found].angle = q - apart, roots[found++].merged = 0;
                    }
                    continue;
                }
            }
        }
        if (doubt && among(roots, found, q, fold) >= 0) doubt->found = 1;
        if (near >= 0)
            roots[near].angle = q, roots[near].merged = 1;
        else if (found < KR_MAX_ROOTS)
            roots[found].angle = q, roots[found++].merged = merged;
    }
    return sorted(roots, found);
}
