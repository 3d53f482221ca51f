/* Joint 5 moves the tip across the plane of axes 2, 3 and 4 by what joint 1 has to make up for: two values of q1 for a q5. In
 * that plane, with x the point and t the tip from axis 4, and phi the sum of the three angles, the trace is
 *   A cos phi + B sin phi + C
 * with A, B and C functions of q1 and q5, so that the best and the worst phi are known in closed form, and what is left is a
 * function of q5 alone. The two links reach x - R(phi) t with the elbow on either side. Where the elbow is straight, and where
 * joint 2, 3 or 4 is at a limit, phi follows from
 *   |x - c - R(phi) (t + e)| = length
 * with constants c and e; with two of them there, from the direction alone, and q5 from length 0. */
#include "pitched.h"

#include "chain.h"

#include <math.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, EVEN = 40, GRID = EVEN + 4, REFINED = 40, HALVED = 26 };
/* Axes are parallel if they are off by less; the angle between axes 1 and 2 is larger than this [rad]. */
static const double PARALLEL = 1e-4, ACROSS = 0.05;
/* How far a start may be outside the limits [rad], because Newton's method has yet to move it. */
static const double NEAR = 1e-2;
static const double SLACK = 1e-9;
/* A slope that is none where it is none for many q5. */
static const double FLAT = 1e-12;
/* How much the cosine of an elbow that is almost straight may be larger than 1. */
static const double MERGING = 1e-9;

static void rotated(double angle, const double v[2], double to[2]) {
    const double c = cos(angle), s = sin(angle);
    to[0] = c * v[0] - s * v[1], to[1] = s * v[0] + c * v[1];
}

void kr_pitched_prepare(const kr_arm *arm, kr_five_axis *five) {
    static const double zero[N] = {0.0};
    const int n = arm->n;
    const double *A1 = arm->placements + 12;
    double F[12 * (N + 1)], in[4][12];  /* frames of joints 3 and 4, what follows joint 4, and the tip, in that of joint 2 */
    five->pitched = 0;
    kr_frames(n, arm->placements, zero, F);
    for (int k = 0; k < 3; k++) {
        const double *G = F + 12, *H = F + 12 * (k < 2 ? k + 2 : n);
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 4; c++)
                in[k][4 * r + c] = G[r] * H[c] + G[4 + r] * H[4 + c] + G[8 + r] * H[8 + c];
            in[k][4 * r + 3] -= G[r] * G[3] + G[4 + r] * G[7] + G[8 + r] * G[11];
        }
    }
    if (hypot(A1[2], A1[6]) < ACROSS) return;
    five->sense[0] = 1.0;
    for (int k = 0; k < 2; k++) {
        if (hypot(in[k][2], in[k][6]) > PARALLEL) return;
        five->sense[k + 1] = in[k][10] > 0.0 ? 1.0 : -1.0;
    }
    memset(five->tip, 0, sizeof five->tip), memset(five->turn, 0, sizeof five->turn);
    for (int k = 0; k < 2; k++) five->upper[k] = in[0][4 * k + 3], five->fore[k] = in[1][4 * k + 3] - in[0][4 * k + 3];
    if (!(hypot(five->upper[0], five->upper[1]) > SLACK && hypot(five->fore[0], five->fore[1]) > SLACK)) return;
    if (n == 4) {
        for (int r = 0; r < 3; r++) {
            five->tip[0][r] = in[2][4 * r + 3] - (r < 2 ? in[1][4 * r + 3] : 0.0);
            for (int c = 0; c < 3; c++) five->turn[0][3 * r + c] = in[2][4 * r + c];
        }
    } else {
        const double *B = arm->placements + 12 * n;
        double a[12];
        kr_times(in[1], arm->placements + 12 * 4, a);
        for (int r = 0; r < 3; r++) {
            const double x = a[4 * r], y = a[4 * r + 1], z = a[4 * r + 2];
            for (int c = 0; c < 4; c++) {
                const double part[3] = {z * B[8 + c], x * B[c] + y * B[4 + c], y * B[c] - x * B[4 + c]};
                for (int k = 0; k < 3; k++)
                    if (c < 3) five->turn[k][3 * r + c] = part[k];
                    else five->tip[k][r] = part[k];
            }
            five->tip[0][r] += a[4 * r + 3] - (r < 2 ? in[1][4 * r + 3] : 0.0);
        }
    }
    five->pitched = 1;
}

/* What depends on q5 and q1, and its derivatives by q5 along the curve on which q1 makes up for it. */
typedef struct {
    int exists;
    double q1, q5, x[2], dx[2], t[2], dt[2], k[3], dk[3];
} sample;

typedef struct {
    const kr_five_axis *five;
    const kr_stationary_goal *goal;
    int fixed, limits;
    const double *given;
    kr_start *start;
    void *context;
    double point[3], w[9];             /* the point and W before joint 1 */
    double cosine, sine, height, size; /* of the condition on q1; its amplitude */
    double upper, fore;                /* lengths */
    double q5[GRID + 3];               /* in rising order, the first three once more at the end */
    sample grid[2][GRID];
} search;

/* Fill in a sample at q1 and q5; `rate` is the derivative of q1. */
static void fill(const search *s, double q1, double rate, double q5, sample *at) {
    const double *A1 = s->goal->arm->placements + 12, c = cos(q1), n = sin(q1), c5 = cos(q5), s5 = sin(q5);
    const double y[3] = {c * s->point[0] + n * s->point[1] - A1[3], c * s->point[1] - n * s->point[0] - A1[7],
                         s->point[2] - A1[11]};
    const double dy[2] = {rate * (y[1] + A1[7]), -rate * (y[0] + A1[3])};
    double N0[9], dN[9], h[9], dh[9], m[9], dm[9];
    at->exists = 1, at->q1 = q1, at->q5 = q5;
    for (int k = 0; k < 2; k++) {
        at->x[k] = A1[k] * y[0] + A1[4 + k] * y[1] + A1[8 + k] * y[2];
        at->dx[k] = A1[k] * dy[0] + A1[4 + k] * dy[1];
        at->t[k] = s->five->tip[0][k] + c5 * s->five->tip[1][k] + s5 * s->five->tip[2][k];
        at->dt[k] = c5 * s->five->tip[2][k] - s5 * s->five->tip[1][k];
    }
    for (int k = 0; k < 3; k++) {
        N0[k] = c * s->w[k] + n * s->w[3 + k], N0[3 + k] = c * s->w[3 + k] - n * s->w[k], N0[6 + k] = s->w[6 + k];
        dN[k] = rate * N0[3 + k], dN[3 + k] = -rate * N0[k];
    }
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            const int i = 3 * r + k;
            m[i] = A1[r] * N0[k] + A1[4 + r] * N0[3 + k] + A1[8 + r] * N0[6 + k];
            dm[i] = A1[r] * dN[k] + A1[4 + r] * dN[3 + k];
            h[i] = s->five->turn[0][i] + c5 * s->five->turn[1][i] + s5 * s->five->turn[2][i];
            dh[i] = c5 * s->five->turn[2][i] - s5 * s->five->turn[1][i];
        }
    for (int i = 0; i < 3; i++) at->k[i] = at->dk[i] = 0.0;
    for (int k = 0; k < 3; k++) {
        at->k[0] += m[k] * h[k] + m[3 + k] * h[3 + k];
        at->k[1] += m[3 + k] * h[k] - m[k] * h[3 + k];
        at->k[2] += m[6 + k] * h[6 + k];
        at->dk[0] += dm[k] * h[k] + m[k] * dh[k] + dm[3 + k] * h[3 + k] + m[3 + k] * dh[3 + k];
        at->dk[1] += dm[3 + k] * h[k] + m[3 + k] * dh[k] - dm[k] * h[3 + k] - m[k] * dh[3 + k];
        at->dk[2] += dm[6 + k] * h[6 + k] + m[6 + k] * dh[6 + k];
    }
}

/* The sample at q5 with q1 on one of two sides. */
static void take(const search *s, double q5, int side, sample *at) {
    const double c5 = cos(q5), s5 = sin(q5);
    const double across = s->five->tip[0][2] + c5 * s->five->tip[1][2] + s5 * s->five->tip[2][2] + s->height;
    const double rate = c5 * s->five->tip[2][2] - s5 * s->five->tip[1][2];
    at->exists = 0;
    if (!(fabs(across) < s->size)) return;
    const double turn = acos(across / s->size), q1 = atan2(s->sine, s->cosine) + (side ? -turn : turn);
    const double slope = s->size * (side ? sin(turn) : -sin(turn));
    fill(s, q1, rate != 0.0 ? rate / slope : 0.0, q5, at);
}

/* How phi follows from a sample. */
typedef struct {
    enum { BEST, WORST, ONE_SIDE, OTHER_SIDE, ALONG } way;
    double c[2], e[2], length;
    int held;
} condition;

/* The cosine and sine of phi, and a function of q5 whose zeros are sought: the slope of the trace, or of a length. Returns 0
 * where there is none. */
static int evaluate(const condition *on, const sample *at, double phi[2], double *value) {
    const double *k = at->k, *d = at->dk;
    if (!at->exists) return 0;
    if (on->way == BEST || on->way == WORST) {
        const double size = sqrt(k[0] * k[0] + k[1] * k[1]), sign = on->way == BEST ? 1.0 : -1.0;
        if (!(size > 0.0)) return 0;
        phi[0] = sign * k[0] / size, phi[1] = sign * k[1] / size;
        *value = d[2] + phi[0] * d[0] + phi[1] * d[1];
        return 1;
    }
    const double x = at->x[0] - on->c[0], y = at->x[1] - on->c[1], u = at->t[0] + on->e[0], v = at->t[1] + on->e[1];
    const double xx = x * x + y * y, uu = u * u + v * v, size = sqrt(xx * uu);
    if (!(size > 0.0)) return 0;
    const double c0 = (x * u + y * v) / size, s0 = (y * u - x * v) / size;
    if (on->way == ALONG) {
        phi[0] = c0, phi[1] = s0, *value = xx - uu;
        return 1;
    }
    const double c = 0.5 * (xx + uu - on->length * on->length) / size;
    if (!(fabs(c) <= 1.0)) return 0;
    const double s = (on->way == ONE_SIDE ? 1.0 : -1.0) * sqrt(1.0 - c * c);
    phi[0] = c0 * c - s0 * s, phi[1] = s0 * c + c0 * s;
    const double tx = phi[0] * u - phi[1] * v, ty = phi[1] * u + phi[0] * v;
    const double dx = phi[0] * at->dt[0] - phi[1] * at->dt[1], dy = phi[1] * at->dt[0] + phi[0] * at->dt[1];
    const double change = x * at->dx[0] + y * at->dx[1] + u * at->dt[0] + v * at->dt[1] - at->dx[0] * tx -
                          at->dx[1] * ty - x * dx - y * dy;
    const double across = y * tx - x * ty, turning = k[1] * phi[0] - k[0] * phi[1];
    *value = d[2] + phi[0] * d[0] + phi[1] * d[1] + (change != 0.0 ? turning * change / across : 0.0);
    return 1;
}

/* Whether joints that are not held are within the limits, or almost. */
static int allowed(const search *s, int held, const double *q) {
    const kr_arm *arm = s->goal->arm;
    static const double zero[N] = {0.0};
    double wound[N], bent[N];
    memcpy(bent, q, sizeof bent);
    for (int i = 0; i < arm->n; i++)
        if ((held & ~s->fixed) >> i & 1) bent[i] = arm->lower[i];
    return kr_wound(arm->n, bent, zero, arm->lower, arm->upper, NEAR, wound);
}

/* Start from the postures at a sample with a known phi, with the elbow on either side. */
static void found(const search *s, const condition *on, int held, const sample *at, const double phi[2]) {
    const kr_five_axis *five = s->five;
    const int straight = on->way > WORST && !on->held;
    const double wx = at->x[0] - phi[0] * at->t[0] + phi[1] * at->t[1];
    const double wy = at->x[1] - phi[1] * at->t[0] - phi[0] * at->t[1], r = wx * wx + wy * wy;
    double bend = 0.5 * (r - s->upper * s->upper - s->fore * s->fore) / (s->upper * s->fore), q[2][N];
    if (straight || fabs(bend) < 1.0 + MERGING) bend = fmax(-1.0, fmin(1.0, bend));
    if (!(fabs(bend) <= 1.0)) return;
    const double au = atan2(five->upper[1], five->upper[0]), af = atan2(five->fore[1], five->fore[0]);
    for (int elbow = 0; elbow < (straight ? 1 : 2); elbow++) {
        const double eta = elbow ? -acos(bend) : acos(bend);
        const double first = atan2(wy, wx) - au - atan2(s->fore * sin(eta), s->upper + s->fore * cos(eta));
        const double second = eta + au - af;
        double *p = q[elbow];
        memcpy(p, s->given, s->goal->arm->n * sizeof *p);
        p[0] = at->q1, p[1] = five->sense[0] * first, p[2] = five->sense[1] * second;
        p[3] = five->sense[2] * (atan2(phi[1], phi[0]) - first - second);
        if (s->goal->arm->n == 5) p[4] = at->q5;
    }
    int from = 0, to = straight ? 1 : 2;
    if (on->held) {  /* the elbow at which the joints at a limit are there */
        double off[2] = {0.0, 0.0};
        for (int elbow = 0; elbow < 2; elbow++)
            for (int i = 1; i < 4; i++)
                if (on->held >> i & 1) off[elbow] += fabs(kr_wrapped(q[elbow][i] - s->given[i]));
        from = off[1] < off[0], to = from + 1;
    }
    for (int elbow = from; elbow < to; elbow++) {
        for (int i = 0; i < s->goal->arm->n; i++)
            if (held >> i & 1) q[elbow][i] = s->given[i];
        if (!s->limits || allowed(s, held, q[elbow])) s->start(s->context, held | s->fixed, q[elbow]);
    }
}

/* The zero between two values of q5 with values of opposite sign. */
static void refine(const search *s, const condition *on, int side, double a, double value_a, double b, double value_b) {
    double phi[2], value;
    sample at;
    for (int step = 0;; step++) {
        double q5 = (a * value_b - b * value_a) / (value_b - value_a);
        if (!(fabs(value_a) < 1e6 && fabs(value_b) < 1e6) || step == 1) q5 = 0.5 * (a + b);
        take(s, q5, side, &at);
        if (!evaluate(on, &at, phi, &value)) return;
        if (step == REFINED || fabs(value) < 1e-14 || fabs(b - a) < 1e-15) break;
        if ((value > 0.0) == (value_a > 0.0)) {
            a = q5, value_a = value;
            if (step > 1) value_b *= 0.5;
        } else {
            b = q5, value_b = value;
            if (step > 1) value_a *= 0.5;
        }
    }
    found(s, on, on->held, &at, phi);
}

static void between(const search *s, const condition *on, int side, double a, double value_a, double b, double value_b) {
    if ((value_a > 0.0) != (value_b > 0.0)) refine(s, on, side, a, value_a, b, value_b);
}

/* The last q5 at which there is a value, next to one at which there is none. */
static void up_to_the_end(const search *s, const condition *on, int side, double q5, double value, double beyond) {
    double inside = q5, last = value, phi[2];
    sample at;
    for (int step = 0; step < HALVED; step++) {
        const double middle = 0.5 * (inside + beyond);
        double there;
        take(s, middle, side, &at);
        if (evaluate(on, &at, phi, &there)) inside = middle, last = there;
        else beyond = middle;
    }
    between(s, on, side, q5, value, inside, last);
}

/* Values of q5 around the circle. Two are next to each of those at which the tip is farthest across: there q1 turns back, and
 * zeros may be close together. */
static void set_grid(search *s) {
    static const double BESIDE = 1e-4;
    const double farthest = atan2(s->five->tip[2][2], s->five->tip[1][2]);
    for (int i = 0; i < EVEN; i++) s->q5[i] = KR_TURN * (i + 0.37) / EVEN - KR_PI;
    for (int i = EVEN; i < GRID; i++) {
        const double q5 = kr_wrapped(farthest + (i & 2 ? KR_PI : 0.0) + (i & 1 ? BESIDE : -BESIDE));
        int at = i;
        for (; at > 0 && s->q5[at - 1] > q5; at--) s->q5[at] = s->q5[at - 1];
        s->q5[at] = q5;
    }
    for (int i = 0; i < 3; i++) s->q5[GRID + i] = s->q5[i] + KR_TURN;
}

/* Zeros over q5 with q1 on one side. */
static void along(const search *s, const condition *on, int side) {
    double value[GRID + 3], phi[2];
    int exists[GRID + 3];
    int flat = 0;
    for (int i = 0; i < GRID + 3; i++) {
        exists[i] = evaluate(on, &s->grid[side][i % GRID], phi, value + i);
        flat += exists[i] && fabs(value[i]) < FLAT;
    }
    if (flat > GRID / 4) {  /* joint 5 is free, as where the tip points along axis 1: it stays where it is, if it can */
        sample at;
        take(s, s->given[4], side, &at);
        for (int i = 0; i < GRID && !evaluate(on, &at, phi, value); i++) at = s->grid[side][i];
        if (evaluate(on, &at, phi, value)) found(s, on, on->held, &at, phi);
        return;
    }
    for (int i = 0; i < GRID; i++) {
        const double a = s->q5[i], b = s->q5[i + 1], c = s->q5[i + 2];
        if (exists[i] && exists[i + 1]) {
            between(s, on, side, a, value[i], b, value[i + 1]);
            /* two zeros between a and c: the parabola through the three values is steady, and has another sign there */
            const double v0 = value[i], v1 = value[i + 1], v2 = value[i + 2];
            if (!exists[i + 2] || (v0 > 0.0) != (v1 > 0.0) || (v1 > 0.0) != (v2 > 0.0)) continue;
            if (!(fabs(v1) <= fabs(v0) && fabs(v1) <= fabs(v2))) continue;
            const double rise = (v1 - v0) / (b - a), bend = ((v2 - v1) / (c - b) - rise) / (c - a);
            const double steady = bend != 0.0 ? 0.5 * (a + b) - 0.5 * rise / bend : b;
            double there;
            sample at;
            take(s, steady, side, &at);
            if (!evaluate(on, &at, phi, &there) || (there > 0.0) == (v1 > 0.0)) continue;
            between(s, on, side, fmin(b, steady), steady < b ? there : v1, fmax(b, steady), steady < b ? v1 : there);
            if (steady > b) between(s, on, side, steady, there, c, v2);
            else between(s, on, side, a, v0, steady, there);
        } else if (exists[i])
            up_to_the_end(s, on, side, a, value[i], b);
        else if (exists[i + 1])
            up_to_the_end(s, on, side, b, value[i + 1], a);
    }
}

/* What is stationary at one sample: `held` are joints 1 and 5 as far as they are at limits. */
static void at_once(const search *s, const condition *on, int held, const sample *at) {
    double phi[2], value;
    if (evaluate(on, at, phi, &value)) found(s, on, held | on->held, at, phi);
}

/* The conditions with the pitches free: six. */
static int free_pitches(const search *s, condition *all) {
    int count = 0;
    memset(all, 0, 6 * sizeof *all);
    for (int way = BEST; way <= WORST; way++) all[count++].way = way;
    for (int side = 0; side < 4; side++) {
        all[count].way = side & 1 ? ONE_SIDE : OTHER_SIDE;
        all[count++].length = side & 2 ? s->upper + s->fore : fabs(s->upper - s->fore);
    }
    return count;
}

/* The condition with some of joints 2, 3 and 4 held where `given` has them. */
static condition at_limits(const search *s, int held, const double *given) {
    const kr_five_axis *five = s->five;
    const double first = five->sense[0] * given[1], second = five->sense[1] * given[2], third = five->sense[2] * given[3];
    condition on = {ALONG, {0.0, 0.0}, {0.0, 0.0}, 0.0, held};
    double part[2];
    const int at2 = held >> 1 & 1, at3 = held >> 2 & 1, at4 = held >> 3 & 1;
    if (at2) {
        rotated(first, five->upper, on.c);
        if (at3) {
            rotated(first + second, five->fore, part);
            on.c[0] += part[0], on.c[1] += part[1];
        }
    }
    if (at4) {
        rotated(-third, five->fore, on.e);
        if (at3) {
            rotated(-second - third, five->upper, part);
            on.e[0] += part[0], on.e[1] += part[1];
        }
    }
    if (at2 && !at3 && !at4) on.length = s->fore;
    if (at4 && !at3 && !at2) on.length = s->upper;
    if (at3 && !at2 && !at4) {
        rotated(second, five->fore, part);
        on.length = hypot(five->upper[0] + part[0], five->upper[1] + part[1]);
    }
    return on;
}

static int limited(const kr_arm *arm, int joint) { return arm->upper[joint] - arm->lower[joint] < KR_TURN - SLACK; }

enum { MOST = 6 + 2 * 6 + 12 };

void kr_pitched_starts(const kr_five_axis *five, const kr_stationary_goal *goal, int fixed, int limits, const double *q,
                       kr_start *start, void *context) {
    const kr_arm *arm = goal->arm;
    const double *A0 = arm->placements, *A1 = A0 + 12;
    const int rolls = arm->n == 5 && !fixed;
    double given[MOST][N];
    condition on[MOST];
    search s;
    s.five = five, s.goal = goal, s.fixed = fixed, s.limits = limits, s.start = start, s.context = context;
    s.upper = hypot(five->upper[0], five->upper[1]), s.fore = hypot(five->fore[0], five->fore[1]);
    for (int r = 0; r < 3; r++) {
        s.point[r] = A0[r] * (goal->p[0] - A0[3]) + A0[4 + r] * (goal->p[1] - A0[7]) + A0[8 + r] * (goal->p[2] - A0[11]);
        for (int c = 0; c < 3; c++)
            s.w[3 * r + c] = A0[r] * goal->W[c] + A0[4 + r] * goal->W[3 + c] + A0[8 + r] * goal->W[6 + c];
    }
    const double b[3] = {A1[2], A1[6], A1[10]};
    s.cosine = b[0] * s.point[0] + b[1] * s.point[1], s.sine = b[0] * s.point[1] - b[1] * s.point[0];
    s.height = b[0] * A1[3] + b[1] * A1[7] + b[2] * (A1[11] - s.point[2]);
    s.size = sqrt(s.cosine * s.cosine + s.sine * s.sine);
    s.given = q;
    int count = free_pitches(&s, on);
    for (int k = 0; k < count; k++) memcpy(given[k], q, arm->n * sizeof *q);
    for (int i = 1; limits && i < 4; i++)  /* joints at limits, and pairs of them */
        for (int j = i; limited(arm, i) && j < 4; j++) {
            if (!limited(arm, j) || (i != j && !rolls)) continue;
            for (int ends = 0; ends < (i == j ? 2 : 4); ends++) {
                double *here = given[count];
                memcpy(here, q, arm->n * sizeof *q);
                here[i] = ends & 1 ? arm->upper[i] : arm->lower[i];
                if (i != j) here[j] = ends & 2 ? arm->upper[j] : arm->lower[j];
                on[count] = at_limits(&s, 1 << i | 1 << j, here);
                if (i != j) {
                    count++;
                    continue;
                }
                for (int side = 0; side < 2; side++) {
                    if (side) on[count] = on[count - 1], memcpy(given[count], here, sizeof given[count]);
                    on[count++].way = side ? OTHER_SIDE : ONE_SIDE;
                }
            }
        }
    if (!rolls) {
        for (int side = 0; side < 2; side++) {
            take(&s, arm->n == 5 ? q[4] : 0.0, side, &s.grid[0][0]);
            for (int k = 0; k < count; k++) s.given = given[k], at_once(&s, on + k, 0, &s.grid[0][0]);
        }
        return;
    }
    set_grid(&s);
    for (int side = 0; side < 2; side++) {
        for (int i = 0; i < GRID; i++) take(&s, s.q5[i], side, &s.grid[side][i]);
        for (int k = 0; k < count; k++) s.given = given[k], along(&s, on + k, side);
    }
    for (int i = 0; limits && i < 5; i += 4)
        for (int end = 0; limited(arm, i) && end < 2; end++) {
            const double bound = end ? arm->upper[i] : arm->lower[i];
            for (int side = 0; side < 2; side++) {
                sample at;
                if (i == 4)
                    take(&s, bound, side, &at);
                else {  /* q5 that needs this q1 */
                    const double c = five->tip[1][2], n = five->tip[2][2], size = hypot(c, n);
                    const double rest = cos(bound) * s.cosine + sin(bound) * s.sine - s.height - five->tip[0][2];
                    at.exists = 0;
                    if (!(size > SLACK) || !(fabs(rest) < size)) continue;
                    const double turn = acos(rest / size);
                    fill(&s, bound, 0.0, kr_wrapped(atan2(n, c) + (side ? -turn : turn)), &at);
                }
                for (int k = 0; k < count; k++) {
                    if (on[k].way == ALONG) continue;
                    given[k][i] = bound, s.given = given[k];
                    at_once(&s, on + k, 1 << i, &at);
                }
            }
        }
}
