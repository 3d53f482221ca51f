/* Joint 5 moves the tip across the plane of axes 2, 3 and 4 by what joint 1 has to make up for: two values of q1 for a q5. In
 * that plane, with x the point and t the tip from axis 4, and phi the sum of the three angles, the trace is
 *   A cos phi + B sin phi + C
 * with A, B and C functions of q1 and q5, so that the best and the worst phi are known in closed form, and what is left is a
 * function of q5 alone. The two links reach x - R(phi) t with the elbow on either side. Where the elbow is straight, and where
 * joint 2, 3 or 4 is at a limit, phi follows from
 *   |x - c - R(phi) (t + e)| = length
 * with constants c and e; with two of them there, from the direction alone, and q5 from length 0.
 *
 * All of these are linear in (1, cos q1, sin q1) and in (1, cos q5, sin q5): a sample of q5 needs no other angle. Slopes are
 * multiplied by what makes them infinite where a curve of postures turns back, and stay bounded there. */
#include "pitched.h"

#include "chain.h"
#include "sincos.h"

#include <math.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, EVEN = 40, ENDS = 4, GRID = EVEN + 4 + 3 * ENDS, REFINED = 40 };
/* Axes are parallel if they are off by less; the angle between axes 1 and 2 is larger than this [rad]. */
static const double PARALLEL = 1e-4, ACROSS = 0.05;
/* How far a start may be outside the limits [rad], because Newton's method has yet to move it. */
static const double NEAR = 1e-2;
static const double SLACK = 1e-9;
/* A zero, and the end of a curve, are between two q5 that are so close [rad]; or it is so small a share of the first values. */
static const double CLOSE = 1e-9, ZERO = 1e-15;
/* Between two values a cubic is less by at most this share of both changes, or twice as much as it could be; one that is never
 * nearer to 0 than this share of the less has no zeros there. */
static const double DEEPEST = 0.3, NEAR_ZERO = 0.9;
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

/* What depends on q5 and q1, and its derivatives along the curve on which q1 makes up for q5, by a parameter of which `rate`
 * is the derivative of q5. */
typedef struct {
    int exists;
    double q5, rate, c1, s1, x[2], dx[2], t[2], dt[2], k[3], dk[3];
} sample;

typedef struct {
    const kr_five_axis *five;
    const kr_stationary_goal *goal;
    int fixed, limits;
    const double *given;
    kr_start *start;
    void *context;
    double K[3][3][3], X[2][3];        /* k and x as sums over (1, cos q1, sin q1); k over (1, cos q5, sin q5), too */
    double c0, s0, height, size;       /* of the condition on q1: a direction, and its amplitude */
    double upper, fore, upper_angle, fore_angle;
    int samples;
    double q5[GRID + 2];               /* in rising order, the first two once more at the end */
    sample grid[2][GRID];
    int open[2][GRID + 1];             /* whether a posture between a sample and the next may be within the limits */
} search;

/* The products of the point and of W before joint 1 with what joint 1 and joint 5 turn. */
static void set_sums(search *s) {
    const kr_stationary_goal *goal = s->goal;
    const double *A0 = goal->arm->placements, *A1 = A0 + 12;
    double p[3], w[9], M[3][9];
    for (int r = 0; r < 3; r++) {
        p[r] = A0[r] * (goal->p[0] - A0[3]) + A0[4 + r] * (goal->p[1] - A0[7]) + A0[8 + r] * (goal->p[2] - A0[11]);
        for (int c = 0; c < 3; c++)
            w[3 * r + c] = A0[r] * goal->W[c] + A0[4 + r] * goal->W[3 + c] + A0[8 + r] * goal->W[6 + c];
    }
    const double b[3] = {A1[2], A1[6], A1[10]}, cosine = b[0] * p[0] + b[1] * p[1], sine = b[0] * p[1] - b[1] * p[0];
    s->height = b[0] * A1[3] + b[1] * A1[7] + b[2] * (A1[11] - p[2]);
    s->size = sqrt(cosine * cosine + sine * sine);
    s->c0 = s->size > 0.0 ? cosine / s->size : 1.0, s->s0 = s->size > 0.0 ? sine / s->size : 0.0;
    for (int k = 0; k < 2; k++) {
        s->X[k][0] = A1[8 + k] * (p[2] - A1[11]) - A1[k] * A1[3] - A1[4 + k] * A1[7];
        s->X[k][1] = A1[k] * p[0] + A1[4 + k] * p[1];
        s->X[k][2] = A1[k] * p[1] - A1[4 + k] * p[0];
    }
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) {
            M[0][3 * r + k] = A1[8 + r] * w[6 + k];
            M[1][3 * r + k] = A1[r] * w[k] + A1[4 + r] * w[3 + k];
            M[2][3 * r + k] = A1[r] * w[3 + k] - A1[4 + r] * w[k];
        }
    for (int a = 0; a < 3; a++)
        for (int c = 0; c < 3; c++) {
            const double *m = M[a], *h = s->five->turn[c];
            double sum[3] = {0.0};
            for (int k = 0; k < 3; k++) {
                sum[0] += m[k] * h[k] + m[3 + k] * h[3 + k];
                sum[1] += m[3 + k] * h[k] - m[k] * h[3 + k];
                sum[2] += m[6 + k] * h[6 + k];
            }
            for (int j = 0; j < 3; j++) s->K[j][a][c] = sum[j];
        }
}

/* Fill in a sample at q1 and q5; by the parameter, q1 changes by `turning` and q5 by `rate`. */
static void fill(const search *s, double c1, double s1, double turning, double q5, double c5, double s5, double rate,
                 sample *at) {
    at->exists = 1, at->q5 = q5, at->rate = rate, at->c1 = c1, at->s1 = s1;
    for (int k = 0; k < 2; k++) {
        const double *X = s->X[k], constant = s->five->tip[0][k], c = s->five->tip[1][k], n = s->five->tip[2][k];
        at->x[k] = X[0] + c1 * X[1] + s1 * X[2];
        at->dx[k] = turning * (c1 * X[2] - s1 * X[1]);
        at->t[k] = constant + c5 * c + s5 * n;
        at->dt[k] = rate * (c5 * n - s5 * c);
    }
    for (int j = 0; j < 3; j++) {
        double at_q5[3], slope[3];
        for (int a = 0; a < 3; a++) {
            const double *K = s->K[j][a];
            at_q5[a] = K[0] + c5 * K[1] + s5 * K[2];
            slope[a] = c5 * K[2] - s5 * K[1];
        }
        at->k[j] = at_q5[0] + c1 * at_q5[1] + s1 * at_q5[2];
        at->dk[j] = rate * (slope[0] + c1 * slope[1] + s1 * slope[2]) + turning * (c1 * at_q5[2] - s1 * at_q5[1]);
    }
}

/* The sample at q5 with q1 on one of two sides. */
static void take(const search *s, double q5, double c5, double s5, int side, sample *at) {
    const double constant = s->five->tip[0][2], c = s->five->tip[1][2], n = s->five->tip[2][2];
    const double across = constant + c5 * c + s5 * n + s->height;
    at->exists = 0;
    if (!(fabs(across) < s->size)) return;
    const double ct = across / s->size, st = sqrt((1.0 - ct) * (1.0 + ct)), sine = side ? -st : st;
    const double turning = (s5 * c - c5 * n) / s->size;
    fill(s, s->c0 * ct - s->s0 * sine, s->s0 * ct + s->c0 * sine, side ? -turning : turning, q5, c5, s5, st, at);
}

static void take_at(const search *s, double q5, int side, sample *at) {
    double c5, s5;
    kr_sincos(q5, &s5, &c5);
    take(s, q5, c5, s5, side, at);
}

/* How phi follows from a sample: the best and the worst; by a length, on one side and on the other; or by a direction. */
typedef struct {
    enum { PITCH, LENGTH, ALONG } way;
    double c[2], e[2], length;
    int held;
} condition;

/* The two vectors of a length, their squares, and the square of the root in phi: without it, there is no phi. */
typedef struct {
    double x, y, u, v, xx, uu, middle, square;
} lengths;

static lengths lengths_of(const condition *on, const sample *at) {
    lengths l;
    l.x = at->x[0] - on->c[0], l.y = at->x[1] - on->c[1], l.u = at->t[0] + on->e[0], l.v = at->t[1] + on->e[1];
    l.xx = l.x * l.x + l.y * l.y, l.uu = l.u * l.u + l.v * l.v;
    l.middle = 0.5 * (l.xx + l.uu - on->length * on->length);
    l.square = l.xx * l.uu - l.middle * l.middle;
    return l;
}

/* Functions of q5 whose zeros are sought, one or two: the slope of the trace, or of a length, times what has no sign. Returns
 * what the slope was multiplied by, 0 where there is none; `square` becomes that of the root in phi, if there is one. */
static double evaluate(const condition *on, const sample *at, double value[2], double *square) {
    const double *k = at->k, *d = at->dk;
    *square = 1.0;
    if (!at->exists) return 0.0;
    if (on->way == PITCH) {
        const double size = sqrt(k[0] * k[0] + k[1] * k[1]), along = k[0] * d[0] + k[1] * d[1];
        value[0] = size * d[2] + along, value[1] = size * d[2] - along;
        return size * at->rate;
    }
    const lengths l = lengths_of(on, at);
    if (!(l.xx * l.uu > 0.0)) return 0.0;
    if (on->way == ALONG) {
        value[0] = l.xx - l.uu;
        return 1.0;
    }
    *square = l.square;
    if (!(l.square >= 0.0)) return 0.0;
    const double root = sqrt(l.square), inverse = 1.0 / (l.xx * l.uu);
    const double dot = inverse * (l.x * l.u + l.y * l.v), cross = inverse * (l.y * l.u - l.x * l.v);
    const double away = l.x * at->dx[0] + l.y * at->dx[1] + l.u * at->dt[0] + l.v * at->dt[1];
    /* x . R(phi) dt + dx . R(phi) t is a cos phi + b sin phi */
    const double a = l.x * at->dt[0] + l.y * at->dt[1] + at->dx[0] * l.u + at->dx[1] * l.v;
    const double b = l.y * at->dt[0] - l.x * at->dt[1] + at->dx[1] * l.u - at->dx[0] * l.v;
    int bent = 0;
    for (int side = 0; side < 2; side++) {
        const double turn = side ? -root : root, c = dot * l.middle - cross * turn, n = cross * l.middle + dot * turn;
        const double change = away - a * c - b * n, turning = k[1] * c - k[0] * n, level = d[2] + c * d[0] + n * d[1];
        bent |= change != 0.0;
        value[side] = change != 0.0 ? root * level - (side ? -turning : turning) * change : level;
    }
    return (bent ? fmax(root, 1e-300) : 1.0) * at->rate;
}

/* The cosine and sine of phi on one side. */
static void pitch_of(const condition *on, const sample *at, int side, double phi[2]) {
    if (on->way == PITCH) {
        const double size = hypot(at->k[0], at->k[1]), sign = side ? -1.0 : 1.0;
        phi[0] = sign * at->k[0] / size, phi[1] = sign * at->k[1] / size;
        return;
    }
    const lengths l = lengths_of(on, at);
    const double size = sqrt(l.xx * l.uu), dot = (l.x * l.u + l.y * l.v) / size, cross = (l.y * l.u - l.x * l.v) / size;
    const double root = sqrt(fmax(l.square, 0.0)) / size;
    const double c = on->way == ALONG ? 1.0 : l.middle / size, n = on->way == ALONG ? 0.0 : side ? -root : root;
    phi[0] = dot * c - cross * n, phi[1] = cross * c + dot * n;
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

/* Start from the postures at a sample, with the elbow on either side. */
static void found(const search *s, const condition *on, int held, const sample *at, int side) {
    const kr_five_axis *five = s->five;
    const int straight = on->way == LENGTH && !on->held;
    double phi[2], q[2][N];
    pitch_of(on, at, side, phi);
    const double wx = at->x[0] - phi[0] * at->t[0] + phi[1] * at->t[1];
    const double wy = at->x[1] - phi[1] * at->t[0] - phi[0] * at->t[1], r = wx * wx + wy * wy;
    double bend = 0.5 * (r - s->upper * s->upper - s->fore * s->fore) / (s->upper * s->fore);
    if (straight || fabs(bend) < 1.0 + MERGING) bend = fmax(-1.0, fmin(1.0, bend));
    if (!(fabs(bend) <= 1.0)) return;
    const double bent = acos(bend), height = s->fore * sqrt((1.0 - bend) * (1.0 + bend));
    const double inner = atan2(height, s->upper + s->fore * bend), outer = atan2(wy, wx) - s->upper_angle;
    const double turned = atan2(phi[1], phi[0]), q1 = atan2(at->s1, at->c1);
    for (int elbow = 0; elbow < (straight ? 1 : 2); elbow++) {
        const double first = elbow ? outer + inner : outer - inner;
        const double second = (elbow ? -bent : bent) + s->upper_angle - s->fore_angle;
        double *p = q[elbow];
        memcpy(p, s->given, s->goal->arm->n * sizeof *p);
        p[0] = q1, p[1] = five->sense[0] * first, p[2] = five->sense[1] * second;
        p[3] = five->sense[2] * (turned - first - second);
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

/* A function of q5: how far from where there is no phi, or one of a condition's. */
enum { END = 2 };
typedef struct {
    const search *s;
    const condition *on;
    int side, which;  /* of q1; of phi, or END */
    sample at;
} function;

/* Its value; returns 0 where there is none. */
static int value_of(function *f, double q5, double *value) {
    double values[2], square;
    take_at(f->s, q5, f->side, &f->at);
    if (f->which == END) {
        *value = f->at.exists ? lengths_of(f->on, &f->at).square : -1.0;
        return 1;
    }
    if (!(evaluate(f->on, &f->at, values, &square) > 0.0)) return 0;
    *value = values[f->which];
    return 1;
}

/* The zero between two q5 with values of opposite sign, by inverse quadratic interpolation or halving (T. Chandrupatla, A new
 * hybrid quadratic/bisection algorithm, 1997). The two become those next to it. Returns 0 where there is no value. */
static int zero_of(function *f, double *a, double *value_a, double *b, double *value_b) {
    const double small = f->which == END ? -1.0 : ZERO * fmin(fmax(fabs(*value_a), fabs(*value_b)), 1.0);
    double x1 = *a, f1 = *value_a, x2 = *b, f2 = *value_b, x3 = x2, f3 = f2, t = f1 / (f1 - f2);
    if (!(t > 0.01)) t = 0.01;
    if (!(t < 0.99)) t = 0.99;
    for (int step = 0; step < REFINED; step++) {
        const double x = x1 + t * (x2 - x1);
        double value;
        if (!value_of(f, x, &value)) return 0;
        if ((value > 0.0) == (f1 > 0.0)) x3 = x1, f3 = f1;
        else x3 = x2, f3 = f2, x2 = x1, f2 = f1;
        x1 = x, f1 = value;
        const double least = 0.5 * CLOSE / fabs(x2 - x1);
        if (least > 0.5 || fmin(fabs(f1), fabs(f2)) <= small) break;
        const double xi = (x1 - x2) / (x3 - x2), share = (f1 - f2) / (f3 - f2);
        t = 0.5;
        if (share * share < xi && (1.0 - share) * (1.0 - share) < 1.0 - xi)
            t = f1 / (f2 - f1) * f3 / (f2 - f3) + (x3 - x1) / (x2 - x1) * f1 / (f3 - f1) * f2 / (f3 - f2);
        t = fmin(fmax(t, least), 1.0 - least);
    }
    const int swapped = (f1 > 0.0) != (*value_a > 0.0);
    *a = swapped ? x2 : x1, *value_a = swapped ? f2 : f1, *b = swapped ? x1 : x2, *value_b = swapped ? f1 : f2;
    return 1;
}

/* Start from the zero between two q5, if there is one. What is least at a limit is where the slope falls. */
static void between(const search *s, const condition *on, int side, int which, double a, double value_a, double b,
                    double value_b) {
    if ((value_a > 0.0) == (value_b > 0.0)) return;
    if (on->held && on->way == LENGTH && (value_a > 0.0) != (a < b)) return;
    function f = {.s = s, .on = on, .side = side, .which = which};
    double value;
    if (!zero_of(&f, &a, &value_a, &b, &value_b)) return;
    const double q5 = fabs(value_a) < fabs(value_b) ? a : b;
    if (f.at.q5 != q5 && !value_of(&f, q5, &value)) return;
    found(s, on, on->held, &f.at, which);
}

/* Where the cubic with two values of one sign and slopes is nearest to 0 between them, if it comes near; else NAN. */
static double dip(double a, double value_a, double slope_a, double b, double value_b, double slope_b) {
    const double span = b - a, sign = value_a > 0.0 ? 1.0 : -1.0, v0 = sign * value_a, v1 = sign * value_b;
    const double m0 = sign * slope_a * span, m1 = sign * slope_b * span, least = fmin(v0, v1);
    if (!(v1 >= 0.0 && least < DEEPEST * (fabs(m0) + fabs(m1)))) return NAN;
    const double c2 = 3.0 * (v1 - v0) - 2.0 * m0 - m1, c3 = 2.0 * (v0 - v1) + m0 + m1, square = c2 * c2 - 3.0 * c3 * m0;
    if (!(square > 0.0)) return NAN;
    const double root = sqrt(square), u = c2 > 0.0 ? -m0 / (c2 + root) : (root - c2) / (3.0 * c3);
    if (!(u > 0.0 && u < 1.0) || !(v0 + u * (m0 + u * (c2 + u * c3)) < NEAR_ZERO * least)) return NAN;
    return a + u * span;
}

/* Two zeros on both sides of where there may be two, if the value there has another sign than those next to it. */
static void pair_at(const search *s, const condition *on, int side, int which, double steady, double a, double value_a,
                    double b, double value_b) {
    function f = {.s = s, .on = on, .side = side, .which = which};
    double there;
    if (!value_of(&f, steady, &there) || (there > 0.0) == (value_a > 0.0)) return;
    between(s, on, side, which, a, value_a, steady, there);
    between(s, on, side, which, steady, there, b, value_b);
}

/* Zeros from a q5 to the last before another at which there are values. There both sides of phi meet. */
static void up_to_the_end(const search *s, const condition *on, int side, double q5, const double value[2],
                          double beyond) {
    function f = {.s = s, .on = on, .side = side, .which = END};
    double inside = q5, first, outside = beyond, second, square, middle[2], last[2];
    sample end;
    if (on->way != LENGTH) return;
    value_of(&f, inside, &first), value_of(&f, outside, &second);
    if (!(first > 0.0 && second < 0.0)) return;
    zero_of(&f, &inside, &first, &outside, &second);
    take_at(s, inside, side, &end);
    if (!(evaluate(on, &end, last, &square) > 0.0)) return;
    const double at[3] = {q5, inside + 0.25 * (q5 - inside), inside};
    take_at(s, at[1], side, &f.at);
    if (!(evaluate(on, &f.at, middle, &square) > 0.0)) return;
    for (int which = 0; which < 2; which++) {
        const double v0 = value[which], v1 = middle[which], v2 = last[which];
        between(s, on, side, which, at[0], v0, at[1], v1);
        between(s, on, side, which, at[1], v1, at[2], v2);
        /* by the parabola of the root of the distance from the end, 1 at the first: there the curve turns back */
        const double m0 = 3.0 * v0 - 4.0 * v1 + v2, m1 = v0 - v2, m2 = 4.0 * v1 - v0 - 3.0 * v2;
        const double near = dip(0.0, v2, m2, 0.5, v1, m1), far = dip(0.5, v1, m1, 1.0, v0, m0);
        if (near == near) pair_at(s, on, side, which, inside + near * near * (q5 - inside), at[1], v1, at[2], v2);
        if (far == far) pair_at(s, on, side, which, inside + far * far * (q5 - inside), at[0], v0, at[1], v1);
    }
    if ((last[0] > 0.0) == (last[1] > 0.0)) found(s, on, on->held, &end, 0);
}

/* Past which end of its limits a joint is, -1 or 1: so far that Newton's method brings it back no more. */
static int past(const kr_arm *arm, int joint, double c, double n) {
    const double middle = 0.5 * (arm->lower[joint] + arm->upper[joint]);
    const double half = arm->upper[joint] - middle + NEAR;
    if (!(half < KR_PI)) return 0;
    const double cm = cos(middle), sm = sin(middle);
    if (c * cm + n * sm >= cos(half)) return 0;
    return n * cm - c * sm > 0.0 ? 1 : -1;
}

/* Samples around the circle. Two are next to each of those at which the tip is farthest across: there q1 turns back, and
 * zeros may be close together. Between two others q1 only rises or falls. Three come before each end of what q1 makes up
 * for, the last one as good as there. */
static void set_grid(search *s) {
    static const double BESIDE = 1e-4, BEFORE[3] = {1e-10, 0.01, 0.04};
    const double c = s->five->tip[1][2], n = s->five->tip[2][2], farthest = atan2(n, c), radius = hypot(c, n);
    double c5[GRID], s5[GRID], extra[4 + 3 * ENDS];
    int count = 0;
    for (int i = 0; i < 4; i++) extra[count++] = farthest + (i & 2 ? KR_PI : 0.0) + (i & 1 ? BESIDE : -BESIDE);
    for (int i = 0; i < ENDS; i++) {
        const double rest = (i & 2 ? s->size : -s->size) - s->height - s->five->tip[0][2];
        if (!(fabs(rest) < radius)) continue;
        const double turn = acos(rest / radius), into = i & 2 ? 1.0 : -1.0, sign = i & 1 ? -1.0 : 1.0;
        for (int k = 0; k < 3; k++) extra[count++] = farthest + sign * (turn + into * BEFORE[k]);
    }
    for (int i = 0; i < EVEN; i++) s->q5[i] = KR_TURN * (i + 0.37) / EVEN - KR_PI;
    s->samples = EVEN + count;
    for (int i = EVEN; i < s->samples; i++) {
        const double q5 = kr_wrapped(extra[i - EVEN]);
        int at = i;
        for (; at > 0 && s->q5[at - 1] > q5; at--) s->q5[at] = s->q5[at - 1];
        s->q5[at] = q5;
    }
    for (int i = 0; i < 2; i++) s->q5[s->samples + i] = s->q5[i] + KR_TURN;
    kr_sincos_of_each(s->samples, s->q5, s5, c5);
    for (int side = 0; side < 2; side++) {
        int out[GRID + 1], rolled[GRID + 1];
        for (int i = 0; i < s->samples; i++) {
            sample *at = &s->grid[side][i];
            take(s, s->q5[i], c5[i], s5[i], side, at);
            rolled[i] = s->limits ? past(s->goal->arm, 4, c5[i], s5[i]) : 0;
            out[i] = s->limits && at->exists ? past(s->goal->arm, 0, at->c1, at->s1) : 0;
        }
        out[s->samples] = out[0], rolled[s->samples] = rolled[0];
        for (int i = 0; i < s->samples; i++)
            s->open[side][i] = !(out[i] && out[i] == out[i + 1]) && !(rolled[i] && rolled[i] == rolled[i + 1]);
        s->open[side][s->samples] = s->open[side][0];
    }
}

/* Values at all samples, the first two once more at the end, and slopes there. */
typedef struct {
    double value[GRID + 2], slope[GRID + 2];
} course;

/* Slopes from the values on both sides, as far as there are some. */
static void set_slopes(const search *s, const int *exists, course *of) {
    const int samples = s->samples;
    double *v = of->value;
    for (int i = 1; i <= samples; i++) {
        const double before = s->q5[i] - s->q5[i - 1], after = s->q5[i + 1] - s->q5[i];
        const double down = (v[i] - v[i - 1]) / before, up = (v[i + 1] - v[i]) / after;
        of->slope[i] = !exists[i - 1] ? up : !exists[i + 1] ? down : (down * after + up * before) / (before + after);
    }
    of->slope[0] = of->slope[samples], of->slope[samples + 1] = of->slope[1];
}

static double dip_of(const search *s, const course *of, int i) {
    return dip(s->q5[i], of->value[i], of->slope[i], s->q5[i + 1], of->value[i + 1], of->slope[i + 1]);
}

/* Where the root in phi is there at two samples, or at neither, it may be another way between them. */
static void turn_between(const search *s, const condition *on, int side, int i, int exists, const course *square,
                         const course value[2]) {
    const double steady = dip_of(s, square, i), a = s->q5[i], b = s->q5[i + 1];
    double values[2], there;
    sample at;
    if (!(steady == steady)) return;
    take_at(s, steady, side, &at);
    if (!at.exists || (evaluate(on, &at, values, &there) > 0.0) == exists) return;
    const double low[2] = {value[0].value[i], value[1].value[i]}, high[2] = {value[0].value[i + 1], value[1].value[i + 1]};
    up_to_the_end(s, on, side, exists ? a : steady, exists ? low : values, exists ? steady : a);
    up_to_the_end(s, on, side, exists ? b : steady, exists ? high : values, exists ? steady : b);
}

/* Zeros over q5 with q1 on one side. */
static void along(const search *s, const condition *on, int side) {
    const int ways = on->way == ALONG ? 1 : 2, *open = s->open[side], samples = s->samples;
    course of[2], square;
    double values[2];
    int exists[GRID + 2], sampled[GRID + 2], flat[2] = {0, 0}, tried = 0;
    for (int i = 0; i < samples; i++) {
        const int before = (i + samples - 1) % samples, earlier = (i + samples - 2) % samples;
        exists[i] = 0, square.value[i] = of[0].value[i] = of[1].value[i] = 0.0;
        sampled[i] = s->grid[side][i].exists && (open[i] || open[i + 1] || open[before] || open[earlier]);
        if (!sampled[i]) continue;
        tried++;
        const double scale = evaluate(on, &s->grid[side][i], values, square.value + i);
        if (!(scale > 0.0)) continue;
        exists[i] = 1;
        for (int which = 0; which < ways; which++) {
            of[which].value[i] = values[which];
            flat[which] += fabs(values[which]) < FLAT * scale;
        }
    }
    for (int i = 0; i < 2; i++) {
        const int end = samples + i;
        exists[end] = exists[i], sampled[end] = sampled[i], square.value[end] = square.value[i];
        for (int which = 0; which < ways; which++) of[which].value[end] = of[which].value[i];
    }
    if (on->way == LENGTH) set_slopes(s, sampled, &square);
    for (int which = 0; which < ways; which++) {
        set_slopes(s, exists, of + which);
        flat[which] = flat[which] > 2 && 4 * flat[which] > tried;
        if (!flat[which]) continue;
        /* joint 5 is free, as where the tip points along axis 1: it stays as near to where it is as it can */
        sample at;
        double there, nearest = INFINITY;
        take_at(s, s->given[4], side, &at);
        const int stays = evaluate(on, &at, values, &there) > 0.0;
        for (int i = 0; i < samples && !stays; i++) {
            const double away = fabs(kr_wrapped(s->q5[i] - s->given[4]));
            if (exists[i] && away < nearest) nearest = away, at = s->grid[side][i];
        }
        found(s, on, on->held, &at, which);
    }
    for (int i = 0; i < samples; i++) {
        const double a = s->q5[i], b = s->q5[i + 1];
        if (!open[i]) continue;
        if (on->way == LENGTH && sampled[i] && sampled[i + 1] && exists[i] == exists[i + 1])
            turn_between(s, on, side, i, exists[i], &square, of);
        if (exists[i] != exists[i + 1]) {
            const int last = exists[i] ? i : i + 1;
            const double ends[2] = {of[0].value[last], of[1].value[last]};
            up_to_the_end(s, on, side, s->q5[last], ends, exists[i] ? b : a);
            continue;
        }
        for (int which = 0; exists[i] && which < ways; which++) {
            if (flat[which]) continue;
            const double v0 = of[which].value[i], v1 = of[which].value[i + 1];
            if ((v0 > 0.0) != (v1 > 0.0)) {
                between(s, on, side, which, a, v0, b, v1);
                continue;
            }
            const double steady = dip_of(s, of + which, i);
            if (steady == steady) pair_at(s, on, side, which, steady, a, v0, b, v1);
        }
    }
}

/* What is stationary at one sample: `held` are joints 1 and 5 as far as they are at limits. */
static void at_once(const search *s, const condition *on, int held, const sample *at) {
    double values[2], square;
    const int ways = on->way == ALONG || (on->way == PITCH && held & ~s->fixed) ? 1 : 2;
    if (!(evaluate(on, at, values, &square) > 0.0)) return;
    for (int which = 0; which < ways; which++) found(s, on, held | on->held, at, which);
}

/* The conditions with the pitches free. */
static int free_pitches(const search *s, condition *all) {
    memset(all, 0, 3 * sizeof *all);
    all[0].way = PITCH, all[1].way = all[2].way = LENGTH;
    all[1].length = s->upper + s->fore, all[2].length = fabs(s->upper - s->fore);
    return 3;
}

/* The condition with some of joints 2, 3 and 4 held where `given` has them. */
static condition at_limits(const search *s, int held, const double *given) {
    const kr_five_axis *five = s->five;
    const double first = five->sense[0] * given[1], second = five->sense[1] * given[2], third = five->sense[2] * given[3];
    condition on = {.way = held & (held - 1) ? ALONG : LENGTH, .held = held};
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

enum { MOST = 3 + 6 + 12 };

void kr_pitched_starts(const kr_five_axis *five, const kr_stationary_goal *goal, int fixed, int limits, const double *q,
                       kr_start *start, void *context) {
    const kr_arm *arm = goal->arm;
    const int rolls = arm->n == 5 && !fixed;
    double given[MOST][N];
    condition on[MOST];
    search s;
    s.five = five, s.goal = goal, s.fixed = fixed, s.limits = limits, s.start = start, s.context = context;
    s.upper = hypot(five->upper[0], five->upper[1]), s.fore = hypot(five->fore[0], five->fore[1]);
    s.upper_angle = atan2(five->upper[1], five->upper[0]), s.fore_angle = atan2(five->fore[1], five->fore[0]);
    s.given = q;
    set_sums(&s);
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
                on[count++] = at_limits(&s, 1 << i | 1 << j, here);
            }
        }
    if (!rolls) {
        for (int side = 0; side < 2; side++) {
            take_at(&s, arm->n == 5 ? q[4] : 0.0, side, &s.grid[0][0]);
            for (int k = 0; k < count; k++) s.given = given[k], at_once(&s, on + k, 0, &s.grid[0][0]);
        }
        return;
    }
    set_grid(&s);
    for (int side = 0; side < 2; side++)
        for (int k = 0; k < count; k++) s.given = given[k], along(&s, on + k, side);
    for (int i = 0; limits && i < 5; i += 4)
        for (int end = 0; limited(arm, i) && end < 2; end++) {
            const double bound = end ? arm->upper[i] : arm->lower[i];
            for (int side = 0; side < 2; side++) {
                sample at;
                if (i == 4)
                    take_at(&s, bound, side, &at);
                else {  /* q5 that needs this q1 */
                    const double c = five->tip[1][2], n = five->tip[2][2], size = hypot(c, n);
                    const double towards = cos(bound) * s.c0 + sin(bound) * s.s0;
                    const double rest = towards * s.size - s.height - five->tip[0][2];
                    at.exists = 0;
                    if (!(size > SLACK) || !(fabs(rest) < size)) continue;
                    const double turn = acos(rest / size), q5 = kr_wrapped(atan2(n, c) + (side ? -turn : turn));
                    fill(&s, cos(bound), sin(bound), 0.0, q5, cos(q5), sin(q5), 1.0, &at);
                }
                for (int k = 0; k < count; k++) {
                    if (on[k].way == ALONG) continue;
                    given[k][i] = bound, s.given = given[k];
                    at_once(&s, on + k, 1 << i, &at);
                }
            }
        }
}
