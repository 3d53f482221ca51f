#include "self_motion.h"

#include "chain.h"
#include "core.h"
#include "sincos.h"

#include <math.h>
#include <string.h>

enum { N = KR_SEVEN };
/* Newton's method stops at an error below this [m, rad]; what is added to a matrix before it is inverted; longest step of
 * a joint [rad]. */
static const double CONVERGED = 1e-13, NUDGE = 1e-14, MAX_JOINT_STEP = 0.3;
/* After a step whose joints turn by less in all, the error is not computed again but bounded [rad]. */
static const double TINY_STEP = 1e-6;
/* A step of Newton's method contracts to a posture if it leaves less than this share of the way, and a little more. */
static const double CONTRACTS = 0.25, LITTLE = 1e-6;
/* Least pivot of Cholesky's factor. */
static const double TINY = 1e-18;
/* Steps of the inverse iteration. */
enum { ITERATIONS = 3 };

int kr_solve_seven(double M[49], double b[14]) {
    int sign = 1;
    for (int k = 0; k < N; k++) {
        int p = k;
        double best = fabs(M[N * k + k]);
        for (int i = k + 1; i < N; i++)
            if (fabs(M[N * i + k]) > best) best = fabs(M[N * i + k]), p = i;
        if (!(best > 0.0)) return 0;
        if (p != k) {
            sign = -sign;
            for (int j = k; j < N; j++) {
                const double t = M[N * k + j];
                M[N * k + j] = M[N * p + j];
                M[N * p + j] = t;
            }
            for (int j = 0; j < 2; j++) {
                const double t = b[2 * k + j];
                b[2 * k + j] = b[2 * p + j];
                b[2 * p + j] = t;
            }
        }
        if (M[N * k + k] < 0.0) sign = -sign;
        const double inverse = 1.0 / M[N * k + k];
        for (int i = k + 1; i < N; i++) {
            const double f = M[N * i + k] * inverse;
            for (int j = k + 1; j < N; j++) M[N * i + j] -= f * M[N * k + j];
            for (int j = 0; j < 2; j++) b[2 * i + j] -= f * b[2 * k + j];
        }
        M[N * k + k] = inverse;
    }
    for (int k = N - 1; k >= 0; k--)
        for (int j = 0; j < 2; j++) {
            double s = b[2 * k + j];
            for (int i = k + 1; i < N; i++) s -= M[N * k + i] * b[2 * i + j];
            b[2 * k + j] = s * M[N * k + k];
        }
    return sign;
}

/* Move a posture by a step, shortened if it is long. */
static void move(double q[N], const double *step, int stride) {
    double longest = 0.0;
    for (int j = 0; j < N; j++) longest = fmax(longest, fabs(step[stride * j]));
    const double scale = longest > MAX_JOINT_STEP ? MAX_JOINT_STEP / longest : 1.0;
    for (int j = 0; j < N; j++) q[j] += scale * step[stride * j];
}

/* The geometric Jacobian; a joint that slides by s moves the tip by s along its axis. */
static void jacobian(const double *A, const double *F, double J[6 * N]) {
    const double *pitches = A + 12 * (N + 1);
    kr_jacobian_of(N, F, J);
    for (int j = 0; j < N; j++)
        for (int r = 0; r < 3 && pitches[j] != 0.0; r++) {
            J[N * r + j] = pitches[j] * J[N * (r + 3) + j];
            J[N * (r + 3) + j] = 0.0;
        }
}

/* The Jacobian and a direction below it. */
static void bordered(const double *A, const double *F, const double direction[N], double M[49]) {
    jacobian(A, F, M);
    memcpy(M + 42, direction, N * sizeof *M);
    for (int i = 0; i < N; i++) M[(N + 1) * i] += NUDGE;
}

/* Frames of the joints and of the tip, as `kr_frames`, with joints that slide; all sines and cosines at once. */
static void frames(const double *restrict A, const double q[N], double *restrict F) {
    double s[N], c[N];
    const double *restrict pitches = A + 12 * (N + 1);
    kr_sincos_of_each(N, q, s, c);
    memcpy(F, A, 12 * sizeof *F);
    for (int i = 0; i < N; i++, F += 12) {
        if (pitches[i] != 0.0) {
            s[i] = 0.0, c[i] = 1.0;
            for (int r = 0; r < 12; r += 4) F[r + 3] += pitches[i] * q[i] * F[r + 2];
        }
        const double *restrict a = A + 12 * (i + 1);
        double *restrict next = F + 12;
        for (int r = 0; r < 12; r += 4) {
            const double x = c[i] * F[r] + s[i] * F[r + 1], y = c[i] * F[r + 1] - s[i] * F[r], z = F[r + 2];
            for (int k = 0; k < 4; k++) next[r + k] = x * a[k] + y * a[4 + k] + z * a[8 + k];
            next[r + 3] += F[r + 3];
            F[r] = x;
            F[r + 1] = y;
        }
    }
}

/* By how much a posture misses the pose at most after a step of Newton's method, from what the linear equations left: the
 * second derivatives of the tip's pose are less than all links and slides together, and than 1. Infinite if the step is not tiny. */
static double missed_after(const double A[KR_LOOP], const double *step, int stride, double left) {
    double sum = 0.0, reach = 1.0;
    for (int j = 0; j < N; j++) sum += fabs(step[stride * j]);
    if (!(sum < TINY_STEP)) return INFINITY;
    for (int i = 12; i < 12 * (N + 1); i += 12) reach += fabs(A[i + 3]) + fabs(A[i + 7]) + fabs(A[i + 11]);
    for (int i = 12 * (N + 1); i < KR_LOOP; i++) reach += KR_TURN * fabs(A[i]);  /* it slides within half a turn */
    return left + reach * sum * sum;
}

/* The unit vector along a tangent, every second of b; returns 0 if it has no direction. */
static int unit(const double *b, double tangent[N]) {
    double square = 0.0;
    for (int j = 0; j < N; j++) square += b[2 * j] * b[2 * j];
    if (!(0.0 < square && square < INFINITY)) return 0;
    const double inverse = 1.0 / sqrt(square);
    for (int j = 0; j < N; j++) tangent[j] = inverse * b[2 * j];
    return 1;
}

double kr_step_along(const double A[KR_LOOP], const double T[12], const double direction[7], int steps, double q[7],
                     double tangent[7], int *sign) {
    double F[12 * (N + 1)], M[49], twist[6], b[14], missed;
    *sign = 0;
    for (;; steps--) {
        frames(A, q, F);
        missed = kr_twist_to(F + 12 * N, T, twist);
        if (!(missed < INFINITY)) return missed;
        bordered(A, F, direction, M);
        for (int i = 0; i < 6; i++) b[2 * i] = twist[i], b[2 * i + 1] = 0.0;
        b[12] = 0.0, b[13] = 1.0;
        const int side = kr_solve_seven(M, b), there = !(CONVERGED <= missed) || steps <= 0;
        if (!side) return there ? missed : INFINITY;
        if (!there) {
            move(q, b, 2);
            const double after = missed_after(A, b, 2, 0.0);
            if (!(after < CONVERGED)) continue;
            missed = after;
        }
        *sign = tangent && unit(b + 1, tangent) ? side : 0;
        return missed;
    }
}

double kr_across(const double A[KR_LOOP], const double T[12], const double direction[7], int steps, double q[7]) {
    int sign;
    return kr_step_along(A, T, direction, steps, q, NULL, &sign);
}

int kr_contracts(const double A[KR_LOOP], const double T[12], const double direction[7], const double start[7],
                 const double q[7], int *sign) {
    double F[12 * (N + 1)], M[49], twist[6], b[14] = {0.0}, apart = 0.0, left = 0.0;
    frames(A, q, F);
    bordered(A, F, direction, M);
    frames(A, start, F);
    const double missed = kr_twist_to(F + 12 * N, T, twist);
    for (int i = 0; i < 6; i++) b[2 * i] = twist[i];
    *sign = kr_solve_seven(M, b);
    for (int j = 0; j < N; j++) {
        const double away = kr_wrapped(start[j] - q[j]);
        apart = fmax(apart, fabs(away));
        left = fmax(left, fabs(away + b[2 * j]));
    }
    return *sign && missed < INFINITY && left <= CONTRACTS * apart + LITTLE;
}

int kr_tangent_along(const double A[KR_LOOP], const double q[7], const double direction[7], double tangent[7]) {
    double F[12 * (N + 1)], M[49], b[14] = {0.0};
    frames(A, q, F);
    bordered(A, F, direction, M);
    b[13] = 1.0;
    const int sign = kr_solve_seven(M, b);
    return sign && unit(b + 1, tangent) ? sign : 0;
}

int kr_tangent(const double A[KR_LOOP], const double q[7], double tangent[7]) {
    double F[12 * (N + 1)], J[6 * N], M[49], b[14] = {0.0}, square = 1.0;
    int column[N] = {0, 1, 2, 3, 4, 5, 6};
    frames(A, q, F);
    jacobian(A, F, J);
    memcpy(M, J, sizeof J);
    for (int k = 0; k < 6; k++) {  /* elimination; the column that is left is free */
        int row = k, col = k;
        double best = -1.0;
        for (int i = k; i < 6; i++)
            for (int j = k; j < N; j++)
                if (fabs(J[N * i + j]) > best) best = fabs(J[N * i + j]), row = i, col = j;
        if (!(best >= 0.0 && best < INFINITY)) return 0;
        for (int j = 0; j < N; j++) {
            const double t = J[N * k + j];
            J[N * k + j] = J[N * row + j];
            J[N * row + j] = t;
        }
        for (int i = 0; i < 6; i++) {
            const double t = J[N * i + k];
            J[N * i + k] = J[N * i + col];
            J[N * i + col] = t;
        }
        const int c = column[k];
        column[k] = column[col];
        column[col] = c;
        if (fabs(J[(N + 1) * k]) < NUDGE) J[(N + 1) * k] = NUDGE;
        for (int i = k + 1; i < 6; i++) {
            const double f = J[N * i + k] / J[(N + 1) * k];
            for (int j = k; j < N; j++) J[N * i + j] -= f * J[N * k + j];
        }
    }
    double t[N];
    t[6] = 1.0;
    for (int k = 5; k >= 0; k--) {
        double s = 0.0;
        for (int j = k + 1; j < N; j++) s -= J[N * k + j] * t[j];
        t[k] = s / J[(N + 1) * k];
        square += t[k] * t[k];
    }
    if (!(square < INFINITY)) return 0;
    for (int k = 0; k < N; k++) M[42 + column[k]] = tangent[column[k]] = t[k] / sqrt(square);
    const int sign = kr_solve_seven(M, b);
    for (int j = 0; j < N; j++) tangent[j] *= sign;
    return sign != 0;
}

/* Cholesky's factor of J J^T, with something added to its diagonal. */
static void factor(const double J[6 * N], double added, double L[36]) {
    for (int a = 0; a < 6; a++)
        for (int b = 0; b <= a; b++) {
            double s = a == b ? added : 0.0;
            for (int j = 0; j < N; j++) s += J[N * a + j] * J[N * b + j];
            for (int k = 0; k < b; k++) s -= L[6 * a + k] * L[6 * b + k];
            L[6 * a + b] = a == b ? 1.0 / sqrt(fmax(s, TINY)) : s * L[7 * b];
        }
}

/* Solve L L^T x = v, in place; L has the inverses of its diagonal there. */
static void substitute(const double L[36], double v[6]) {
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++) v[i] -= L[6 * i + k] * v[k];
        v[i] *= L[7 * i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) v[i] -= L[6 * k + i] * v[k];
        v[i] *= L[7 * i];
    }
}

double kr_least_of_seven(const double A[KR_LOOP], const double q[7]) {
    double F[12 * (N + 1)], J[6 * N], L[36], v[6], square = 0.0;
    frames(A, q, F);
    jacobian(A, F, J);
    factor(J, TINY, L);
    for (int i = 0; i < 6; i++) v[i] = 1.0 + 0.1 * i;
    for (int step = 0; step < ITERATIONS; step++) {
        substitute(L, v);
        square = 0.0;
        for (int i = 0; i < 6; i++) square += v[i] * v[i];
        for (int i = 0; i < 6; i++) v[i] /= sqrt(square);
    }
    return 1.0 / sqrt(sqrt(square));
}

void kr_across_each(const double A[KR_LOOP], const double T[12], int steps, int count, double *q, double *direction,
                    double *missed) {
    for (int i = 0; i < count; i++) {
        double tangent[N];
        int sign;
        missed[i] = kr_step_along(A, T, direction + N * i, steps, q + N * i, tangent, &sign);
        if (sign) memcpy(direction + N * i, tangent, sizeof tangent);
    }
}

void kr_shortest_steps(const double A[KR_LOOP], const double T[12], int steps, int count, double *q, double *missed) {
    for (int i = 0; i < count; i++) {
        double F[12 * (N + 1)], J[6 * N], L[36], twist[6], v[6], step[N], *x = q + N * i;
        for (int left = steps;; left--) {
            frames(A, x, F);
            missed[i] = kr_twist_to(F + 12 * N, T, twist);
            if (!(CONVERGED <= missed[i] && missed[i] < INFINITY) || left <= 0) break;
            jacobian(A, F, J);
            factor(J, NUDGE, L);
            memcpy(v, twist, sizeof v);
            substitute(L, v);
            for (int j = 0; j < N; j++) {
                step[j] = 0.0;
                for (int a = 0; a < 6; a++) step[j] += J[N * a + j] * v[a];
            }
            move(x, step, 1);
            double slowed = 0.0;  /* (J J^T + NUDGE) v is the twist, J J^T v what the step makes of it */
            for (int a = 0; a < 6; a++) slowed += NUDGE * fabs(v[a]);
            const double after = missed_after(A, step, 1, slowed);
            if (!(after < CONVERGED)) continue;
            missed[i] = after;
            break;
        }
    }
}

void kr_missed_by_each(const double A[KR_LOOP], const double T[12], int count, const double *q, double *missed) {
    for (int i = 0; i < count; i++) {
        double F[12 * (N + 1)], twist[6];
        frames(A, q + N * i, F);
        missed[i] = kr_twist_to(F + 12 * N, T, twist);
    }
}

void kr_tangents(const double A[KR_LOOP], int count, const double *q, const double *ahead, double *tangents) {
    for (int i = 0; i < count; i++, q += N, ahead += N, tangents += N) {
        double square = 0.0;
        for (int j = 0; j < N; j++) square += ahead[j] * ahead[j];
        if (!(square > 0.0 && kr_tangent_along(A, q, ahead, tangents)) && !kr_tangent(A, q, tangents))
            memset(tangents, 0, N * sizeof *tangents);
    }
}

void kr_least_singular_values(const double A[KR_LOOP], int count, const double *q, double *values) {
    for (int i = 0; i < count; i++) values[i] = kr_least_of_seven(A, q + N * i);
}
