/* Closed-form inverse kinematics of a base that turns about z and two links that turn about y.
 *
 * In the frame that turns with joint 1 the tip's sideways offset L is constant: -x sin q1 + y cos q1 = L has two values of
 * q1, front and back. In the plane of the links the law of cosines has two values of the elbow. The branch index is
 * 2 * back + elbow, with elbow 0 for the bend in the joint's positive direction. */
#include "core.h"

#include "chain.h"
#include "rows.h"

#include <math.h>
#include <stddef.h>

enum { BASE = 1, ELBOW = 2 };                              /* what was clamped */
enum { BASE_CYLINDER = 1, ELBOW_OUT = 2, ELBOW_IN = 4 };   /* parts that miss */
enum { JOINTS = 3, WIDTH = JOINTS + 2, BRANCHES = 4 };

/* Postures with the tip at a point, into rows (4, 5); returns how many. `miss` gets the parts that kept others away. */
static int postures(const kr_yaw_planar *g, const double p[3], double tol, double *rows, int *miss) {
    const double *B = g->base, a = g->upper, b = g->fore, side = fabs(g->offset);
    const double x = B[0] * p[0] + B[1] * p[1] + B[2] * p[2] + B[3], y = B[4] * p[0] + B[5] * p[1] + B[6] * p[2] + B[7];
    const double v = B[8] * p[0] + B[9] * p[1] + B[10] * p[2] + B[11] - g->shoulder[1], r = hypot(x, y);
    int count = 0;
    *miss = 0;
    if (r < side - tol) {
        *miss = BASE_CYLINDER;
        return 0;
    }
    const double outward = r > side ? sqrt((r - side) * (r + side)) : 0.0;
    for (int back = 0; back < (r > side ? 2 : 1); back++) {
        const double radial = back ? -outward : outward, u = radial - g->shoulder[0], rho = hypot(u, v);
        if (rho > a + b + tol) {
            *miss |= ELBOW_OUT;
            continue;
        }
        if (rho < fabs(a - b) - tol) {
            *miss |= ELBOW_IN;
            continue;
        }
        double cosine = (rho * rho - a * a - b * b) / (2.0 * a * b);
        const int bent = -1.0 < cosine && cosine < 1.0;
        const double sine = bent ? sqrt(1.0 - cosine * cosine) : 0.0;
        if (!bent) cosine = copysign(1.0, cosine);
        for (int elbow = 0; elbow <= bent; elbow++) {
            const double s = elbow ? -sine : sine;
            double *row = rows + WIDTH * count++;
            row[0] = 2 * back + elbow, row[1] = (r > side ? 0 : BASE) | (bent ? 0 : ELBOW);
            row[2] = kr_wrapped(atan2(y, x) - atan2(g->offset, radial));
            row[3] = kr_wrapped(atan2(u, v) - g->upper_angle - atan2(b * s, a + b * cosine));
            row[4] = kr_wrapped(atan2(s, cosine) - (g->fore_angle - g->upper_angle));
        }
    }
    return count;
}

int kr_yaw_planar_solutions(const kr_yaw_planar *g, const kr_arm *arm, const double p[3], const double *seed, int limits,
                            double tol, double *rows) {
    const double T[12] = {1, 0, 0, p[0], 0, 1, 0, p[1], 0, 0, 1, p[2]};
    int miss;
    const int count = postures(g, p, tol, rows, &miss), kept = kr_within(arm, 2, T, seed, limits, tol, rows, count);
    if (!kept) rows[0] = count, rows[1] = miss;
    return kept;
}

void kr_yaw_planar_solutions_of_each(const kr_yaw_planar *g, const kr_arm *arm, const double *p, int count, int limits,
                                     double tol, double *q, unsigned char *valid) {
    double rows[WIDTH * BRANCHES];
    for (int i = 0; i < count; i++, p += 3, q += JOINTS * BRANCHES, valid += BRANCHES) {
        const int kept = kr_yaw_planar_solutions(g, arm, p, NULL, limits, tol, rows);
        kr_by_branch(JOINTS, BRANCHES, rows, kept, q, valid);
    }
}

void kr_yaw_planar_nearest_of_each(const kr_yaw_planar *g, const kr_arm *arm, const double *p, const double *seeds,
                                   int count, double tol, double *q, long long *branch) {
    double rows[WIDTH * BRANCHES];
    for (int i = 0; i < count; i++, p += 3, seeds += JOINTS, q += JOINTS) {
        const int kept = kr_yaw_planar_solutions(g, arm, p, seeds, 1, tol, rows);
        branch[i] = kept ? (long long)rows[0] : -1;
        for (int j = 0; j < JOINTS; j++) q[j] = kept ? rows[2 + j] : NAN;
    }
}
