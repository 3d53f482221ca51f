/* Inverse kinematics of calibrated UR arms: every posture, exactly.
 *
 * A calibrated arm has no closed form: its axes are tilted by milliradians, so no two of them intersect or are parallel.
 *
 * 1. An arm with a closed form is fitted to it. Over all postures the two differ by a few tenths of a millimetre and a few
 *    milliradians; these bounds are kept.
 * 2. Every posture of the calibrated arm is a posture of the fitted arm for a pose within the bounds. If no pose within
 *    the bounds is singular, each branch of the closed form has exactly one posture: the correction is a contraction, as
 *    its steps shrink by the ratio of the bounds to the distance from the singularity. Newton's method finds the posture
 *    from the closed form's.
 * 3. If a pose within the bounds is singular (wrist centre near the shoulder's cylinder, sin q5 near 0, elbow nearly
 *    stretched or folded), branches may merge or vanish, and near sin q5 = 0 there may be more than eight postures. Two
 *    postures of a stretched elbow are all if both are found. In the other cases, and if Newton's method left its branch,
 *    elimination finds all postures without branches.
 *
 * The branch index is that of the fitted arm's closed form at the same posture. It is continuous as long as no singularity
 * is crossed. Two postures near a singularity may have the same index: the one farther from the singularity keeps it, and
 * the others get indices from 8 on, in no particular order. */
#include "calibrated.h"

#include "chain.h"
#include "elimination.h"
#include "newton.h"
#include "rows.h"

#include <math.h>
#include <string.h>

enum { JOINTS = 6, WIDTH = 8, BRANCHES = 8, STEPS = 6, CALIBRATION = 16 };
/* Branches are distinct if sin q5 is larger than this multiple of the difference's derivative by the free angle. */
static const double WRIST_MARGIN = 3.0;

/* Branch of a posture, and how far it is from the nearest singularity. */
static int branch_of(const kr_calibrated *arm, const double q[JOINTS], double *margin) {
    const kr_ur *g = &arm->fitted;
    const double *zeros = arm->zeros, q2 = q[1] + zeros[1], q3 = q[2] + zeros[2];
    const double shoulder = -g->upper * cos(q2) - g->fore * cos(q2 + q3) + g->d5 * sin(q2 + q3 + q[3] + zeros[3]);
    const double wrist = sin(q[4] + zeros[4]), elbow = sin(q3);
    *margin = fmin(fabs(shoulder), fmin(fabs(wrist), fabs(elbow)));
    return 4 * (shoulder < 0.0) + 2 * (wrist < 0.0) + (elbow < 0.0);
}

/* Whether a pose within the bounds of the fit is singular, except where both postures of the elbow are found.
 *
 * P is the pose of the fitted arm's flange in its base; `has` has a bit for each branch that the fitted arm has. */
static int near_singular(const kr_calibrated *arm, const double P[12], int has) {
    const kr_ur *g = &arm->fitted;
    const double turned = arm->turned, centre = arm->centre;
    const double x = P[3] - g->d6 * P[2], y = P[7] - g->d6 * P[6], z = P[11] - g->d6 * P[10] - g->d1;
    const double r2 = x * x + y * y, r = sqrt(r2), side = sqrt(fmax(0.0, r2 - g->d4 * g->d4));
    if (!(r > g->d4)) return !(r < g->d4 - arm->radius);
    const double pan = centre / side;  /* largest error of q1 [rad] */
    for (int shoulder = 0; shoulder < 2; shoulder++) {
        const double m = (shoulder ? -side : side) / r2, d = g->d4 / r2;
        const double s1 = x * d + y * m, c1 = x * m - y * d;
        const double s5 = hypot(P[0] * s1 - P[4] * c1, P[5] * c1 - P[1] * s1);
        if (!(s5 > 2.0 * turned + WRIST_MARGIN * (arm->wrist[0] + arm->wrist[1] / side))) return 1;
        const double reach = centre * (1.0 + r / side) + 2.0 * g->d5 * (turned + pan) / s5;
        const double u = -x * c1 - y * s1;
        for (int wrist = 0; wrist < 2; wrist++) {
            const double k = (wrist ? -g->d5 : g->d5) / s5;
            const double rho = hypot(u - k * P[10], k * (P[2] * c1 + P[6] * s1) - z);
            const int both = (has >> (4 * shoulder + 2 * wrist)) & 3;
            if (both != 3 && g->folded - reach < rho && rho < g->stretched + reach) return 1;
        }
    }
    return 0;
}

/* Branch indices of the postures of one pose, all different. */
static void name_branches(const kr_calibrated *arm, double *rows, int count) {
    double margin[KR_MAX_POSTURES];
    int index[KR_MAX_POSTURES], taken = 0, spare = BRANCHES;
    for (int i = 0; i < count; i++) index[i] = branch_of(arm, rows + WIDTH * i + 2, margin + i);
    for (int i = 0; i < count; i++) {
        int keeps = 1;
        for (int k = 0; k < count && keeps; k++)
            keeps = index[k] != index[i] || margin[k] < margin[i] || (margin[k] == margin[i] && k >= i);
        rows[WIDTH * i] = keeps ? index[i] : -1.0;
        if (keeps) taken |= 1 << index[i];
    }
    for (int i = 0; i < count; i++)
        if (rows[WIDTH * i] < 0.0) {
            while (taken >> (spare % KR_MAX_POSTURES) & 1) spare++;
            rows[WIDTH * i] = spare % KR_MAX_POSTURES;
            taken |= 1 << (spare % KR_MAX_POSTURES);
        }
    kr_sort_by_branch(rows, count);
}

/* The postures by Newton's method from the fitted arm's rows, in place; returns whether each is on its branch. */
static int all_stay(const kr_calibrated *arm, const double X[12], double *rows, int count) {
    for (int i = 0; i < count; i++) {
        double *row = rows + WIDTH * i, *q = row + 2, margin;
        if (row[1] != 0.0) return 0;
        for (int j = 0; j < JOINTS; j++) q[j] -= arm->zeros[j];
        if (!(kr_newton(arm->elimination.placements, X, STEPS, q) < KR_EXACT)) return 0;
        if (branch_of(arm, q, &margin) != (int)row[0]) return 0;
        for (int j = 0; j < JOINTS; j++) q[j] = kr_wrapped(q[j]);
    }
    return 1;
}

int kr_calibrated_postures(const kr_calibrated *arm, const double T[12], double tol, double *rows, int *miss) {
    static const double zero[JOINTS] = {0.0};
    double X[16], P[12], Y[12], q[KR_MAX_POSTURES * JOINTS];
    int has = 0;
    kr_times(arm->base, T, Y);
    kr_times(Y, arm->flange, X);
    kr_times(arm->fitted.base, X, Y);
    kr_times(Y, arm->fitted.flange, P);
    int count = kr_ur_postures(&arm->fitted, NULL, X, zero, KR_EXACT, rows, miss);
    for (int i = 0; i < count; i++) has |= 1 << (int)rows[WIDTH * i];
    if (!near_singular(arm, P, has) && all_stay(arm, X, rows, count)) return count;
    if (count) *miss = CALIBRATION;
    count = kr_eliminated(&arm->elimination, X, tol, q, NULL);
    for (int i = 0; i < count; i++) {
        rows[WIDTH * i + 1] = 0.0;
        memcpy(rows + WIDTH * i + 2, q + JOINTS * i, JOINTS * sizeof *q);
    }
    name_branches(arm, rows, count);
    return count;
}
