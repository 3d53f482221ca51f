#include "newton.h"

#include "chain.h"
#include "core.h"

#include <math.h>
#include <string.h>

enum { N = 6 };
/* Newton's method stops at an error below this [m, rad]; longest step of a joint [rad]; what is added to a matrix before
 * it is inverted. */
static const double CONVERGED = 1e-13, MAX_JOINT_STEP = 0.3, REGULARISATION = 1e-14;
/* Damped steps have diverged if after so many the error is larger [m, rad]. */
static const int PATIENCE = 12;
static const double DIVERGED = 1e-3;
/* Damping, as a share of the error, and at least. */
static const double DAMPING = 0.03, LEAST_DAMPING = 1e-13;

/* Move a posture by a step, shortened if it is long. */
static void move(double q[N], const double step[N]) {
    double longest = 0.0;
    for (int j = 0; j < N; j++) longest = fmax(longest, fabs(step[j]));
    const double scale = longest > MAX_JOINT_STEP ? MAX_JOINT_STEP / longest : 1.0;
    for (int j = 0; j < N; j++) q[j] += scale * step[j];
}

double kr_newton(const double A[84], const double T[12], int steps, double q[N]) {
    double F[12 * (N + 1)], J[N * N], step[N], missed;
    for (;; steps--) {
        kr_frames(N, A, q, F);
        missed = kr_twist_to(F + 12 * N, T, step);
        if (!(CONVERGED <= missed && missed < INFINITY) || steps <= 0) return missed;
        kr_jacobian_of(N, F, J);
        for (int j = 0; j < N; j++) J[(N + 1) * j] += REGULARISATION;
        if (kr_solve(N, 1, J, step) == 0.0) return missed;
        move(q, step);
    }
}

/* The step that minimises |J step - twist|^2 + damping^2 |step|^2, by Householder's QR factorisation: unlike with J J^T, the
 * smallest singular values keep their digits. Returns 0 if there is none. */
static int damped_step(const double J[N * N], const double twist[N], double damping, double step[N]) {
    double A[2 * N][N + 1];
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) A[i][j] = J[N * i + j], A[N + i][j] = i == j ? damping : 0.0;
        A[i][N] = twist[i], A[N + i][N] = 0.0;
    }
    for (int k = 0; k < N; k++) {  /* below the diagonal there are zeros from row N + k + 1 */
        double square = 0.0;
        for (int i = k; i <= N + k; i++) square += A[i][k] * A[i][k];
        const double size = sqrt(square), head = A[k][k];
        if (!(size > 0.0)) return 0;
        const double beta = 1.0 / (size * (size + fabs(head)));
        A[k][k] += head >= 0.0 ? size : -size;
        for (int j = k + 1; j <= N; j++) {
            double dot = 0.0;
            for (int i = k; i <= N + k; i++) dot += A[i][k] * A[i][j];
            for (int i = k; i <= N + k; i++) A[i][j] -= beta * dot * A[i][k];
        }
        A[k][k] = head >= 0.0 ? -size : size;
    }
    for (int k = N - 1; k >= 0; k--) {
        double x = A[k][N];
        for (int j = k + 1; j < N; j++) x -= A[k][j] * step[j];
        step[k] = x / A[k][k];
    }
    return 1;
}

double kr_damped_newton(const double A[84], const double T[12], int steps, double q[N]) {
    double F[12 * (N + 1)], J[N * N], twist[N], step[N], x[N], best = INFINITY;
    memcpy(x, q, sizeof x);
    for (int k = 0;; k++) {
        kr_frames(N, A, x, F);
        const double missed = kr_twist_to(F + 12 * N, T, twist);
        if (missed < best) {
            best = missed;
            memcpy(q, x, sizeof x);
        }
        if (!(CONVERGED <= missed && missed < INFINITY) || k >= steps || (k >= PATIENCE && best > DIVERGED))
            return best;
        kr_jacobian_of(N, F, J);
        if (!damped_step(J, twist, DAMPING * missed + LEAST_DAMPING, step)) return best;
        move(x, step);
    }
}

double kr_missed(const double A[84], const double T[12], const double q[N]) {
    double F[12 * (N + 1)], twist[N];
    kr_frames(N, A, q, F);
    return kr_twist_to(F + 12 * N, T, twist);
}

double kr_least_singular_value(const double A[84], const double q[N]) {
    double F[12 * (N + 1)], J[N * N], v[N], square = 0.0;
    kr_frames(N, A, q, F);
    kr_jacobian_of(N, F, J);
    for (int i = 0; i < N; i++) v[i] = 1.0 + 0.1 * i;
    for (int step = 0; step < 6; step++) {  /* inverse iteration on J J^T */
        double M[N * N];
        for (int a = 0; a < N; a++)
            for (int b = 0; b < N; b++) {
                double s = a == b ? 1e-18 : 0.0;
                for (int j = 0; j < N; j++) s += J[N * a + j] * J[N * b + j];
                M[N * a + b] = s;
            }
        if (kr_solve(N, 1, M, v) == 0.0) return 0.0;
        square = 0.0;
        for (int i = 0; i < N; i++) square += v[i] * v[i];
        for (int i = 0; i < N; i++) v[i] /= sqrt(square);
    }
    return 1.0 / sqrt(sqrt(square));
}

void kr_newton_of_each(const double A[84], const double *T, int count, int steps, int damped, double *q, double *missed) {
    for (int i = 0; i < count; i++)
        missed[i] = (damped ? kr_damped_newton : kr_newton)(A, T + 16 * i, steps, q + N * i);
}
