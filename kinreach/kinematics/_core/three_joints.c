/* After joint c the tip is at f = f0 + f1 cos qc + f2 sin qc before the turn of joint b. With the origin o and the axis n of
 * joint a in the frame of joint b, the distance from joint a's origin and the height along its axis are
 *   o . Rz(qb) f = (p^2 - f^2 - o^2) / 2,   n . Rz(qb) f = height - o_z
 * linear in v = Rz(qb) (fx, fy). Where both directions are independent they give v as a linear function of cos qc, sin qc, and
 * |v|^2 = fx^2 + fy^2 is quadratic in them (D. Pieper, The kinematics of manipulators under computer control, 1968). Where
 * they are not, one combination is free of v. */
#include "three_joints.h"

#include "chain.h"
#include "circle.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* Directions are dependent if their product is less, as a share of both; shares of squares below this are rounding. */
static const double DEPENDENT = 1e-9, MERGE = 1e-9;

/* A function k0 + k1 cos + k2 sin, and the product of two of them in the order of `kr_circle_roots`, added to `sum`. */
static void add_product(const double a[3], const double b[3], double factor, double sum[6]) {
    sum[0] += factor * a[0] * b[0];
    sum[1] += factor * (a[0] * b[1] + a[1] * b[0]);
    sum[2] += factor * (a[0] * b[2] + a[2] * b[0]);
    sum[3] += factor * a[1] * b[1];
    sum[4] += factor * (a[1] * b[2] + a[2] * b[1]);
    sum[5] += factor * a[2] * b[2];
}

static double at(const double k[3], double c, double s) { return k[0] + k[1] * c + k[2] * s; }

int kr_three_joints(const double B[48], const double p[3], double function[6], double q[3 * KR_MAX_TRIPLES]) {
    const double *A = B + 12, *C = B + 24, *tip = B + 36;
    const double w[3] = {tip[3], tip[7], tip[11]};
    double away[3], f[3][3], height[3], square[3] = {0.0}, o[3], E[3], H[3];
    for (int r = 0; r < 3; r++)
        away[r] = B[r] * (p[0] - B[3]) + B[4 + r] * (p[1] - B[7]) + B[8 + r] * (p[2] - B[11]);
    const double n[3] = {A[8], A[9], A[10]}, rise = A[11];
    double origin = 0.0, distance = 0.0, length = 0.0;
    for (int r = 0; r < 3; r++) {
        o[r] = A[r] * A[3] + A[4 + r] * A[7] + A[8 + r] * A[11];
        origin += o[r] * o[r], distance += away[r] * away[r], length += w[r] * w[r];
        f[r][0] = C[4 * r + 2] * w[2] + C[4 * r + 3];
        f[r][1] = C[4 * r] * w[0] + C[4 * r + 1] * w[1];
        f[r][2] = C[4 * r + 1] * w[0] - C[4 * r] * w[1];
        height[0] = C[4 * r + 3];
        length += height[0] * height[0];
        square[0] += 2.0 * height[0] * C[4 * r + 2] * w[2];
        square[1] += 2.0 * height[0] * f[r][1], square[2] += 2.0 * height[0] * f[r][2];
    }
    square[0] += length;
    for (int k = 0; k < 3; k++) {
        height[k] = f[2][k];
        E[k] = -0.5 * square[k] - o[2] * height[k];
        H[k] = -n[2] * height[k];
    }
    E[0] += 0.5 * (distance - origin);
    H[0] += away[2] - rise;
    const double oo = o[0] * o[0] + o[1] * o[1], nn = n[0] * n[0] + n[1] * n[1], on = o[0] * n[0] + o[1] * n[1];
    const double det = o[0] * n[1] - o[1] * n[0];
    const int independent = fabs(det) > DEPENDENT * fmax(1.0, sqrt(oo)) && oo > 0.0;
    double k[6] = {0.0};
    memset(function, 0, 6 * sizeof *function);
    const double *m = oo > nn ? o : n, mm = oo > nn ? oo : nn;
    if (independent) {
        const double one[3] = {1.0, 0.0, 0.0};
        add_product(E, E, nn, k), add_product(H, H, oo, k), add_product(E, H, -2.0 * on, k);
        add_product(square, one, -det * det, k), add_product(height, height, det * det, k);
        memcpy(function, k, sizeof k);
    } else {
        const double share = mm > 0.0 ? on / mm : 0.0;
        if (!(mm > MERGE)) return 0;
        for (int j = 0; j < 3; j++) k[j] = oo > nn ? H[j] - share * E[j] : E[j] - share * H[j];
    }
    double largest = 0.0;
    if (!q) return 0;
    for (int j = 0; j < 6; j++) largest = fmax(largest, fabs(k[j]));
    if (!(largest > 0.0)) return 0;
    for (int j = 0; j < 6; j++) k[j] /= largest;
    kr_root roots[KR_MAX_ROOTS];
    const int zeros = kr_circle_roots(k, 0.0, MERGE, 0.0, NULL, roots);
    int found = 0;
    for (int i = 0; i < zeros; i++) {
        const double c = cos(roots[i].angle), s = sin(roots[i].angle), e = at(E, c, s), h = at(H, c, s);
        const double fx = at(f[0], c, s), fy = at(f[1], c, s), fz = at(f[2], c, s);
        double v[2][2];
        int ways = 1;
        if (independent) {
            v[0][0] = (e * n[1] - h * o[1]) / det, v[0][1] = (h * o[0] - e * n[0]) / det;
        } else {
            const double along = oo > nn ? e : h, left = (fx * fx + fy * fy) * mm - along * along;
            if (left < -1e-6 * (fx * fx + fy * fy) * mm) continue;
            const double across = left > 0.0 ? sqrt(left) : 0.0;
            ways = across > 0.0 ? 2 : 1;
            for (int way = 0; way < ways; way++) {
                const double side = way ? -across : across;
                v[way][0] = (along * m[0] - side * m[1]) / mm, v[way][1] = (along * m[1] + side * m[0]) / mm;
            }
        }
        for (int way = 0; way < ways && found < KR_MAX_TRIPLES; way++) {
            const double x = v[way][0], y = v[way][1];
            double *angles = q + 3 * found++;
            angles[2] = kr_wrapped(roots[i].angle);
            angles[1] = kr_wrapped(atan2(y, x) - atan2(fy, fx));
            const double gx = A[0] * x + A[1] * y + A[2] * fz + A[3], gy = A[4] * x + A[5] * y + A[6] * fz + A[7];
            angles[0] = kr_wrapped(atan2(away[1], away[0]) - atan2(gy, gx));
        }
    }
    return found;
}
