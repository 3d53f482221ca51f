#include "chain.h"

#include <math.h>

void kr_times(const double a[12], const double b[12], double product[12]) {
    for (int r = 0; r < 3; r++) {
        const double x = a[4 * r], y = a[4 * r + 1], z = a[4 * r + 2];
        for (int c = 0; c < 4; c++) product[4 * r + c] = x * b[c] + y * b[4 + c] + z * b[8 + c];
        product[4 * r + 3] += a[4 * r + 3];
    }
}

void kr_frames(int n, const double *A, const double *q, double *F) {
    for (int i = 0; i <= n; i++) {
        double *f = F + 12 * i;
        if (i == 0)
            for (int k = 0; k < 12; k++) f[k] = A[k];
        else
            kr_times(f - 12, A + 12 * i, f);
        if (i == n) break;
        const double c = cos(q[i]), s = sin(q[i]);
        for (int r = 0; r < 12; r += 4) {
            const double x = f[r], y = f[r + 1];
            f[r] = c * x + s * y;
            f[r + 1] = c * y - s * x;
        }
    }
}

void kr_jacobian_of(int n, const double *F, double *J) {
    const double *tip = F + 12 * n;
    for (int i = 0; i < n; i++) {
        const double *f = F + 12 * i;
        const double x = f[2], y = f[6], z = f[10];
        const double dx = tip[3] - f[3], dy = tip[7] - f[7], dz = tip[11] - f[11];
        J[i] = y * dz - z * dy;
        J[n + i] = z * dx - x * dz;
        J[2 * n + i] = x * dy - y * dx;
        J[3 * n + i] = x;
        J[4 * n + i] = y;
        J[5 * n + i] = z;
    }
}

double kr_twist_to(const double reached[12], const double T[12], double twist[6]) {
    double position = 0.0, turn = 0.0, trace = 0.0;
    for (int r = 0; r < 3; r++) {
        twist[r] = T[4 * r + 3] - reached[4 * r + 3];
        position += twist[r] * twist[r];
    }
    for (int k = 0; k < 3; k++) {
        const double *Ta = T + 4 * ((k + 1) % 3), *Tb = T + 4 * ((k + 2) % 3);
        const double *Ra = reached + 4 * ((k + 1) % 3), *Rb = reached + 4 * ((k + 2) % 3);
        const double *Tk = T + 4 * k, *Rk = reached + 4 * k;
        const double ba = Tb[0] * Ra[0] + Tb[1] * Ra[1] + Tb[2] * Ra[2];
        const double ab = Ta[0] * Rb[0] + Ta[1] * Rb[1] + Ta[2] * Rb[2];
        trace += Tk[0] * Rk[0] + Tk[1] * Rk[1] + Tk[2] * Rk[2];
        twist[3 + k] = 0.5 * (ba - ab);
    }
    for (int k = 3; k < 6; k++) {
        if (trace < 1.0) twist[k] += twist[k] >= 0.0 ? 1.0 : -1.0;
        turn += twist[k] * twist[k];
    }
    return sqrt(position > turn ? position : turn);
}

void kr_pose_error(const double a[12], const double b[12], double error[2]) {
    double square = 0.0, m[9];
    for (int r = 0; r < 3; r++) {
        const double d = a[4 * r + 3] - b[4 * r + 3];
        square += d * d;
        for (int c = 0; c < 3; c++) m[3 * r + c] = a[r] * b[c] + a[4 + r] * b[4 + c] + a[8 + r] * b[8 + c];
    }
    const double x = m[7] - m[5], y = m[2] - m[6], z = m[3] - m[1];
    error[0] = sqrt(square);
    error[1] = atan2(sqrt(x * x + y * y + z * z), m[0] + m[4] + m[8] - 1.0);
}

double kr_solve(int n, int m, double *A, double *b) {
    double least = INFINITY;
    for (int k = 0; k < n; k++) {
        int p = k;
        double best = fabs(A[n * k + k]);
        for (int i = k + 1; i < n; i++)
            if (fabs(A[n * i + k]) > best) best = fabs(A[n * i + k]), p = i;
        if (!(best >= least)) least = best;
        if (!(best > 0.0)) return 0.0;
        if (p != k) {
            for (int j = k; j < n; j++) {
                const double t = A[n * k + j];
                A[n * k + j] = A[n * p + j];
                A[n * p + j] = t;
            }
            for (int j = 0; j < m; j++) {
                const double t = b[m * k + j];
                b[m * k + j] = b[m * p + j];
                b[m * p + j] = t;
            }
        }
        const double inverse = 1.0 / A[n * k + k];
        for (int i = k + 1; i < n; i++) {
            const double f = A[n * i + k] * inverse;
            if (f == 0.0) continue;
            for (int j = k + 1; j < n; j++) A[n * i + j] -= f * A[n * k + j];
            for (int j = 0; j < m; j++) b[m * i + j] -= f * b[m * k + j];
        }
    }
    for (int j = 0; j < m; j++)
        for (int k = n - 1; k >= 0; k--) {
            double s = b[m * k + j];
            for (int i = k + 1; i < n; i++) s -= A[n * k + i] * b[m * i + j];
            b[m * k + j] = s / A[n * k + k];
        }
    return least;
}

int kr_wound(int n, const double *q, const double *seed, const double *lower, const double *upper, double slack,
             double *found) {
    for (int j = 0; j < n; j++) {
        const double low = lower[j] - slack, high = upper[j] + slack, turns = (seed[j] - q[j]) / KR_TURN;
        double value = q[j];
        if (!(-0.5 <= turns && turns <= 0.5)) value += KR_TURN * rint(turns);
        if (value > high)
            value -= KR_TURN * ceil((value - upper[j] - slack) / KR_TURN);
        else if (value < low)
            value += KR_TURN * ceil((lower[j] - slack - value) / KR_TURN);
        if (!(low <= value && value <= high)) return 0;
        found[j] = value;
    }
    return 1;
}
