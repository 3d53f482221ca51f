/* The trace f of W^T R is stationary under the constraint p(q) = p where it is for L = f - lambda . (p(q) - p):
 *   df/dq_i = z_i . a,  a = sum of R_c x W_c over the columns c,
 *   d2f/dq_i dq_j = z_j . S z_i - (z_i . z_j) f,  S = W R^T,    d2p/dq_i dq_j = z_i x (z_j x (p - o_j))    for i <= j.
 * With lambda and the posture Newton's method solves (J. Nocedal, S. Wright, Numerical Optimization, 18.1)
 *   | L''  -J^T | | step   |   | -f'      |
 *   | J     0   | | lambda | = | p - p(q) |.
 * On the null space of J the sign of L'' tells minima from maxima. */
#include "stationary.h"

#include "chain.h"

#include <math.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, MOST_STEPS = 30 };
/* Longest step of a joint [rad]; what is left where Newton's method has arrived [m, rad], and where it counts as arrived
 * after all steps, because there two stationary postures merge; or as a share of the multipliers, which are large next to where
 * the arm is singular: there rounding throws it about. */
static const double MAX_JOINT_STEP = 0.3, ARRIVED = 1e-13, NEARLY = 1e-9, ROUNDED = 1e-11;
/* Curvatures below this are zero, as a share of the trace's largest; pivots of equations, likewise. */
static const double FLAT = 1e-7;
/* A slope that is none; and one that is clearly there, where so little is left. */
static const double LEVEL = 1e-9, CLEARLY = 1e-3, NEXT_TO = 1e-7;

typedef struct {
    int count, joints[N];           /* free joints */
    double J[3][N], first[N], f;    /* of all joints: derivatives of position and trace; and the trace */
    double away[3];                 /* from the tip to the point */
    double z[N][3], S[3][3];
} derivatives;

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void derive(const kr_stationary_goal *goal, int held, const double *q, derivatives *d) {
    const int n = goal->arm->n;
    double F[12 * (N + 1)], a[3] = {0.0};
    kr_frames(n, goal->arm->placements, q, F);
    const double *tip = F + 12 * n, *W = goal->W;
    d->count = 0, d->f = 0.0;
    for (int r = 0; r < 3; r++) {
        const int x = (r + 1) % 3, y = (r + 2) % 3;
        d->away[r] = goal->p[r] - tip[4 * r + 3];
        for (int c = 0; c < 3; c++) {
            d->f += W[3 * r + c] * tip[4 * r + c];
            a[r] += tip[4 * x + c] * W[3 * y + c] - tip[4 * y + c] * W[3 * x + c];
            d->S[r][c] = W[3 * r] * tip[4 * c] + W[3 * r + 1] * tip[4 * c + 1] + W[3 * r + 2] * tip[4 * c + 2];
        }
    }
    for (int i = 0; i < n; i++) {
        const double *f = F + 12 * i, arm[3] = {tip[3] - f[3], tip[7] - f[7], tip[11] - f[11]};
        double *z = d->z[i];
        for (int r = 0; r < 3; r++) z[r] = f[4 * r + 2];
        for (int r = 0; r < 3; r++) d->J[r][i] = z[(r + 1) % 3] * arm[(r + 2) % 3] - z[(r + 2) % 3] * arm[(r + 1) % 3];
        d->first[i] = dot(z, a);
        if (!(held >> i & 1)) d->joints[d->count++] = i;
    }
}

/* Second derivative of the trace less that of lambda . p. */
static double second(const derivatives *d, const double lambda[3], int i, int j) {
    if (i > j) return second(d, lambda, j, i);
    const double *u = d->z[i], *v = d->z[j], x = d->J[0][j], y = d->J[1][j], w = d->J[2][j];
    double turned = 0.0;
    for (int r = 0; r < 3; r++) turned += v[r] * dot(d->S[r], u);
    const double bent = lambda[0] * (u[1] * w - u[2] * y) + lambda[1] * (u[2] * x - u[0] * w) +
                        lambda[2] * (u[0] * y - u[1] * x);
    return turned - dot(u, v) * d->f - bent;
}

/* The multipliers that leave least of the gradient. */
static int least_squares(const derivatives *d, double lambda[3]) {
    double M[9];
    for (int r = 0; r < 3; r++) {
        lambda[r] = 0.0;
        for (int c = 0; c < 3; c++) M[3 * r + c] = r == c ? 1e-16 : 0.0;
        for (int k = 0; k < d->count; k++) {
            const int i = d->joints[k];
            lambda[r] += d->J[r][i] * d->first[i];
            for (int c = 0; c < 3; c++) M[3 * r + c] += d->J[r][i] * d->J[c][i];
        }
    }
    return kr_solve(3, 1, M, lambda) > 0.0;
}

/* A step of the free joints, and the multipliers after it. Returns 0 where the equations are singular. */
static int newton_step(const derivatives *d, double lambda[3], double step[N]) {
    const int m = d->count, size = m + 3;
    double K[(N + 3) * (N + 3)], b[N + 3];
    for (int k = 0; k < m; k++) {
        const int i = d->joints[k];
        for (int l = k; l < m; l++) K[size * k + l] = K[size * l + k] = second(d, lambda, i, d->joints[l]);
        for (int r = 0; r < 3; r++) K[size * k + m + r] = -d->J[r][i], K[size * (m + r) + k] = d->J[r][i];
        b[k] = -d->first[i];
    }
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++) K[size * (m + r) + m + c] = 0.0;
        b[m + r] = d->away[r];
    }
    if (!(kr_solve(size, 1, K, b) > 0.0)) return 0;
    memset(step, 0, N * sizeof *step);
    for (int k = 0; k < m; k++) step[d->joints[k]] = b[k];
    memcpy(lambda, b + m, 3 * sizeof *lambda);
    return 1;
}

int kr_stationary_step(const kr_stationary_goal *goal, int held, const double *q, double step[N]) {
    derivatives d;
    double lambda[3];
    derive(goal, held, q, &d);
    return least_squares(&d, lambda) && newton_step(&d, lambda, step);
}

/* By how much the trace grows with each joint while the tip stays. */
static void slopes_of(int n, const derivatives *d, const double lambda[3], double slope[N]) {
    for (int i = 0; i < n; i++) {
        slope[i] = d->first[i];
        for (int r = 0; r < 3; r++) slope[i] -= lambda[r] * d->J[r][i];
    }
}

/* How much is left of the gradient and of the way to the point. */
static double left(const derivatives *d, const double slope[N]) {
    double most = sqrt(dot(d->away, d->away));
    for (int k = 0; k < d->count; k++) most = fmax(most, fabs(slope[d->joints[k]]));
    return most;
}

/* Whether the trace grows only beyond the limits at which joints are, or by no more than a slope that is none. */
static int is_kept(const kr_arm *arm, const kr_stationary_posture *posture, double level) {
    for (int i = 0; i < arm->n; i++) {
        if (!(posture->face >> i & 1)) continue;
        const int at_upper = fabs(posture->q[i] - arm->upper[i]) <= fabs(posture->q[i] - arm->lower[i]);
        if (at_upper ? posture->slope[i] < -level : posture->slope[i] > level) return 0;
    }
    return 1;
}

/* The kind of stationary posture from the second derivative on the null space of J. */
static int kind_of(const derivatives *d, const double lambda[3]) {
    const int m = d->count;
    double basis[3][N], L[N][N], H[2][2], null[2][N];
    if (m == 3) return KR_MINIMUM;
    for (int r = 0; r < 3; r++) {
        double square = 0.0;
        for (int k = 0; k < m; k++) basis[r][k] = d->J[r][d->joints[k]];
        for (int twice = 0; twice < 2; twice++)
            for (int s = 0; s < r; s++) {
                double along = 0.0;
                for (int k = 0; k < m; k++) along += basis[r][k] * basis[s][k];
                for (int k = 0; k < m; k++) basis[r][k] -= along * basis[s][k];
            }
        for (int k = 0; k < m; k++) square += basis[r][k] * basis[r][k];
        for (int k = 0; k < m; k++) basis[r][k] /= square > 0.0 ? sqrt(square) : 1.0;
    }
    for (int v = 0; v < m - 3; v++) {
        double best = -1.0;
        for (int e = 0; e < m; e++) {  /* the unit vector of which most is in the null space */
            double x[N] = {0.0}, square = 0.0;
            x[e] = 1.0;
            for (int twice = 0; twice < 2; twice++)
                for (int s = 0; s < 3 + v; s++) {
                    const double *other = s < 3 ? basis[s] : null[s - 3];
                    double along = 0.0;
                    for (int k = 0; k < m; k++) along += x[k] * other[k];
                    for (int k = 0; k < m; k++) x[k] -= along * other[k];
                }
            for (int k = 0; k < m; k++) square += x[k] * x[k];
            if (square <= best) continue;
            best = square;
            for (int k = 0; k < m; k++) null[v][k] = x[k] / sqrt(square);
        }
    }
    for (int k = 0; k < m; k++)
        for (int l = k; l < m; l++) L[k][l] = L[l][k] = second(d, lambda, d->joints[k], d->joints[l]);
    for (int v = 0; v < m - 3; v++)
        for (int u = 0; u <= v; u++) {
            H[u][v] = 0.0;
            for (int k = 0; k < m; k++)
                for (int l = 0; l < m; l++) H[u][v] += null[u][k] * null[v][l] * L[k][l];
        }
    double low = H[0][0], high = H[0][0];
    if (m == 5) {
        const double middle = 0.5 * (H[0][0] + H[1][1]), apart = hypot(0.5 * (H[0][0] - H[1][1]), H[0][1]);
        low = middle - apart, high = middle + apart;
    }
    return high <= FLAT ? KR_MINIMUM : low >= -FLAT ? KR_MAXIMUM : KR_SADDLE;  /* of the error: the trace's other way round */
}

int kr_make_stationary(const kr_stationary_goal *goal, kr_stationary_posture *posture) {
    const int n = goal->arm->n;
    derivatives d;
    double lambda[3], step[N], best[N], share = INFINITY, *q = posture->q, *slope = posture->slope;
    derive(goal, posture->held, q, &d);
    if (d.count < 3 || !least_squares(&d, lambda)) return 0;
    for (int k = 0;; k++) {
        slopes_of(n, &d, lambda, slope);
        const double rest = left(&d, slope), of_all = rest / (1.0 + sqrt(dot(lambda, lambda)));
        if (rest < NEXT_TO && !is_kept(goal->arm, posture, CLEARLY)) return 0;
        if (rest < ARRIVED) break;
        if (of_all < share) share = of_all, memcpy(best, q, sizeof best);
        if (k == MOST_STEPS && rest < NEARLY) break;
        if (k == MOST_STEPS || !(rest < INFINITY) || !newton_step(&d, lambda, step)) {
            if (!(share < ROUNDED)) return 0;
            memcpy(q, best, sizeof best);
            derive(goal, posture->held, q, &d);
            if (!least_squares(&d, lambda)) return 0;
            slopes_of(n, &d, lambda, slope);
            break;
        }
        double longest = 0.0;
        for (int i = 0; i < n; i++) longest = fmax(longest, fabs(step[i]));
        if (!(longest < INFINITY)) return 0;
        const double scale = longest > MAX_JOINT_STEP ? MAX_JOINT_STEP / longest : 1.0;
        for (int i = 0; i < n; i++) q[i] += scale * step[i];
        derive(goal, posture->held, q, &d);
        if (scale < 1.0 && !least_squares(&d, lambda)) return 0;
        if (longest < 1e-9) {  /* rounding is left */
            slopes_of(n, &d, lambda, slope);
            if (left(&d, slope) < 1e-11) break;
        }
    }
    if (!is_kept(goal->arm, posture, LEVEL)) return 0;
    posture->trace = d.f;
    posture->kind = kind_of(&d, lambda);
    if (posture->face && posture->kind != KR_MINIMUM) return 0;
    for (int i = 0; i < n; i++)
        if (!(posture->held >> i & 1)) q[i] = kr_wrapped(q[i]);
    return 1;
}
