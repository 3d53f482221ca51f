/* Eigenvalues of a small real matrix: balanced, brought to Hessenberg form by stabilised elementary transformations, and
 * the double-shift QR algorithm (Martin, Peters and Wilkinson, The QR algorithm for real Hessenberg matrices, Numerische
 * Mathematik 14, 1970). */
#include "eigenvalues.h"

#include <float.h>
#include <math.h>

/* Rounds of balancing, at most; steps of the QR algorithm for one eigenvalue, and those with exceptional shifts. */
enum { ROUNDS = 100, STEPS = 60, EXCEPTIONAL = 10 };

/* Scale rows and columns by powers of 2. */
static void balance(int n, double *a) {
    int changed = 1;
    for (int round = 0; changed && round < ROUNDS; round++) {
        changed = 0;
        for (int i = 0; i < n; i++) {
            double row = 0.0, column = 0.0, f = 1.0;
            for (int j = 0; j < n; j++)
                if (j != i) {
                    column += fabs(a[n * j + i]);
                    row += fabs(a[n * i + j]);
                }
            const double sum = column + row;
            if (column == 0.0 || row == 0.0 || !(sum < INFINITY)) continue;
            for (; column < 0.5 * row; column *= 4.0) f *= 2.0;
            for (; column > 2.0 * row; column *= 0.25) f *= 0.5;
            if (!((column + row) / f < 0.95 * sum)) continue;
            changed = 1;
            for (int j = 0; j < n; j++) a[n * i + j] /= f;
            for (int j = 0; j < n; j++) a[n * j + i] *= f;
        }
    }
}

static void swap(double *x, double *y) {
    const double t = *x;
    *x = *y;
    *y = t;
}

static void hessenberg(int n, double *a) {
    for (int m = 1; m < n - 1; m++) {
        int p = m;
        double x = 0.0;
        for (int i = m; i < n; i++)
            if (fabs(a[n * i + m - 1]) > fabs(x)) x = a[n * i + m - 1], p = i;
        if (p != m) {
            for (int j = m - 1; j < n; j++) swap(a + n * p + j, a + n * m + j);
            for (int i = 0; i < n; i++) swap(a + n * i + p, a + n * i + m);
        }
        if (x == 0.0) continue;
        for (int i = m + 1; i < n; i++) {
            const double y = a[n * i + m - 1] / x;
            if (y == 0.0) continue;
            a[n * i + m - 1] = 0.0;
            for (int j = m; j < n; j++) a[n * i + j] -= y * a[n * m + j];
            for (int j = 0; j < n; j++) a[n * j + m] += y * a[n * j + i];
        }
    }
}

/* First row of the block that ends with row `last`; the entry before it becomes 0. */
static int block(int n, double *a, int last, double norm) {
    int first = last;
    for (; first > 0; first--) {
        double s = fabs(a[n * (first - 1) + first - 1]) + fabs(a[n * first + first]);
        if (s == 0.0) s = norm;
        if (fabs(a[n * first + first - 1]) <= DBL_EPSILON * s) {
            a[n * first + first - 1] = 0.0;
            break;
        }
    }
    return first;
}

/* A double QR step with the shifts' sum x + y and product x y - w, on rows `first` to `last`. */
static void step(int n, double *a, int first, int last, double x, double y, double w) {
    double p = 0.0, q = 0.0, r = 0.0;
    int m = last - 2;
    for (; m >= first; m--) {
        const double *here = a + n * m + m, z = here[0], right = x - z, down = y - z;
        p = (right * down - w) / here[n] + here[1];
        q = here[n + 1] - z - right - down;
        r = here[2 * n + 1];
        const double s = fabs(p) + fabs(q) + fabs(r);
        p /= s, q /= s, r /= s;
        if (m == first) break;
        const double u = fabs(here[-1]) * (fabs(q) + fabs(r));
        if (u <= DBL_EPSILON * fabs(p) * (fabs(here[-n - 1]) + fabs(z) + fabs(here[n + 1]))) break;
    }
    for (int i = m + 2; i <= last; i++) {
        a[n * i + i - 2] = 0.0;
        if (i > m + 2) a[n * i + i - 3] = 0.0;
    }
    for (int k = m; k < last; k++) {
        const int third = k != last - 1;
        double size = 1.0;
        if (k != m) {
            p = a[n * k + k - 1];
            q = a[n * (k + 1) + k - 1];
            r = third ? a[n * (k + 2) + k - 1] : 0.0;
            size = fabs(p) + fabs(q) + fabs(r);
            if (size != 0.0) p /= size, q /= size, r /= size;
        }
        const double s = copysign(sqrt(p * p + q * q + r * r), p);
        if (s == 0.0) continue;
        if (k != m)
            a[n * k + k - 1] = -s * size;
        else if (first != m)
            a[n * k + k - 1] = -a[n * k + k - 1];
        p += s;
        const double x1 = p / s, y1 = q / s, z1 = r / s, q1 = q / p, r1 = r / p;
        double *u = a + n * k, *v = u + n, *t = third ? v + n : v;
        const int end = last < k + 3 ? last : k + 3;
        if (third) {
            for (int j = k; j <= last; j++) {
                const double f = u[j] + q1 * v[j] + r1 * t[j];
                u[j] -= f * x1, v[j] -= f * y1, t[j] -= f * z1;
            }
            for (int i = first; i <= end; i++) {
                double *c = a + n * i + k;
                const double f = x1 * c[0] + y1 * c[1] + z1 * c[2];
                c[0] -= f, c[1] -= f * q1, c[2] -= f * r1;
            }
        } else {
            for (int j = k; j <= last; j++) {
                const double f = u[j] + q1 * v[j];
                u[j] -= f * x1, v[j] -= f * y1;
            }
            for (int i = first; i <= end; i++) {
                double *c = a + n * i + k;
                const double f = x1 * c[0] + y1 * c[1];
                c[0] -= f, c[1] -= f * q1;
            }
        }
    }
}

int kr_eigenvalues(int n, double *a, double *real, double *imaginary) {
    double norm = 0.0, shifted = 0.0;
    balance(n, a);
    hessenberg(n, a);
    for (int i = 0; i < n; i++)
        for (int j = i > 0 ? i - 1 : 0; j < n; j++) norm += fabs(a[n * i + j]);
    if (!(norm < INFINITY)) return 0;
    for (int last = n - 1, steps = 0; last >= 0;) {
        const int first = block(n, a, last, norm);
        double *end = a + n * last + last, x = end[0];
        if (first == last) {
            real[last] = x + shifted, imaginary[last] = 0.0;
            last--, steps = 0;
            continue;
        }
        double y = end[-n - 1], w = end[-1] * end[-n];
        if (first == last - 1) {
            const double p = 0.5 * (y - x), q = p * p + w, z = sqrt(fabs(q));
            x += shifted;
            if (q >= 0.0) {
                const double away = p + copysign(z, p);
                real[last - 1] = x + away;
                real[last] = away != 0.0 ? x - w / away : x;
                imaginary[last - 1] = imaginary[last] = 0.0;
            } else {
                real[last - 1] = real[last] = x + p;
                imaginary[last - 1] = z, imaginary[last] = -z;
            }
            last -= 2, steps = 0;
            continue;
        }
        if (steps >= STEPS) return 0;
        if (steps == EXCEPTIONAL || steps == 2 * EXCEPTIONAL || steps == 4 * EXCEPTIONAL) {
            shifted += x;
            for (int i = 0; i <= last; i++) a[n * i + i] -= x;
            const double s = fabs(end[-1]) + fabs(end[-n - 2]);
            x = y = 0.75 * s;
            w = -0.4375 * s * s;
        }
        steps++;
        step(n, a, first, last, x, y, w);
    }
    return 1;
}
