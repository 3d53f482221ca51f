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
 * multiplied by what makes them infinite where a curve of postures turns back, and stay bounded there. Where both sides of q1 or
 * of phi meet, both are one smooth function of the root of the distance from there. Between samples a cubic, and how far it may
 * be off, tell where another value is needed (`zeros_of`). */
#include "pitched.h"

#include "chain.h"
#include "sincos.h"

#include <math.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, EVEN = 40, GRID = EVEN + 4, ENDS = 4, REFINED = 40 };
enum { QUARTERS = 4, ALONG_END = 2 * QUARTERS + 1 };
/* Axes are parallel if they are off by less; the angle between axes 1 and 2 is larger than this [rad]. */
static const double PARALLEL = 1e-4, ACROSS = 0.05;
/* How far a start may be outside the limits [rad], because Newton's method has yet to move it. */
static const double NEAR = 1e-2;
static const double SLACK = 1e-9;
/* A zero, and the end of a curve, are between two q5 that are so close [rad]; or it is so small a share of the first values. */
static const double CLOSE = 1e-9, ZERO = 1e-15;
/* Between two values of one sign there is no zero where they are at least this multiple of what they change by there and
 * beside. A cubic is off by at most so often its next terms. Between two abscissas so close [rad] values are not asked for, nor
 * more than `BUDGET` of a condition beyond its samples. */
enum { BUDGET = 256 };
static const double FAR = 0.6, UNSURE = 8.0, APART = 1e-4;
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

/* An end of what q1 makes up for: q5 there, and from there to where u is 1; samples at the u of `QUARTERS`. */
typedef struct {
    int open;
    double q5, span;
    sample at[ALONG_END];
} turning_point;

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
    int samples, ends;
    double q5[GRID + 1];               /* in rising order, the first once more at the end */
    turning_point end[ENDS];
    sample grid[2][GRID];
    int open[2][GRID];                 /* whether a posture between a sample and the next may be within the limits */
    int needed[2][GRID];               /* samples that exist, where it may be next to one or to the next */
    double x[2][2][GRID], t[2][GRID];  /* x and t at the samples; x is NAN at those that are not needed */
    int covered[GRID];                 /* whether what is between them is next to an end */
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

/* A function of u: how far from where there is no phi, or one of a condition's. u is q5; or, from an end at which both sides
 * of q1 or of phi meet, its square root, of which the function is smooth: negative on the other side. */
enum { END = 2 };
typedef struct {
    const search *s;
    const condition *on;
    int side, which;   /* of q1; of phi, or END */
    double end, span;  /* q5 at the end, and from there to where u is 1; `span` is 0 where u is q5 */
    int turns;         /* q1 has its other side before the end, not phi */
    sample at;
} function;

/* Next to an end: from it by so much. */
static const double AT_END = 1e-5;

static double u_of(int quarter) { return quarter == QUARTERS ? AT_END : (double)(quarter - QUARTERS) / QUARTERS; }

static double q5_of(const function *f, double u) { return f->span != 0.0 ? f->end + f->span * u * u : u; }

/* The sides that u is on, and the sign of the function there. */
static double sides_of(const function *f, double u, int *side, int *which) {
    const int other = f->span != 0.0 && u < 0.0;
    *side = other && f->turns ? 1 - f->side : f->side;
    *which = other && !f->turns ? 1 - f->which : f->which;
    return other ? -1.0 : 1.0;
}

/* Its value; returns 0 where there is none. */
static int value_of(function *f, double u, double *value) {
    double values[2], square;
    int side, which;
    const double sign = sides_of(f, u, &side, &which);
    take_at(f->s, q5_of(f, u), side, &f->at);
    if (f->which == END) {
        *value = f->at.exists ? lengths_of(f->on, &f->at).square : -1.0;
        return 1;
    }
    if (!(evaluate(f->on, &f->at, values, &square) > 0.0)) return 0;
    *value = sign * values[which];
    return 1;
}

/* The zero between two u with values of opposite sign, by inverse quadratic interpolation or halving (T. Chandrupatla, A new
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

/* Start from the zero between two u with values of opposite sign. What is least at a limit is where the slope falls. */
static void start_between(const function *on, double a, double value_a, double b, double value_b) {
    function f = *on;
    int side, which;
    double value;
    const double sign = sides_of(&f, fabs(a) > fabs(b) ? a : b, &side, &which);
    if (f.on->held && f.on->way == LENGTH && (sign * value_a > 0.0) != (q5_of(&f, a) < q5_of(&f, b))) return;
    if (!zero_of(&f, &a, &value_a, &b, &value_b)) return;
    const double u = fabs(value_a) < fabs(value_b) ? a : b;
    if (!value_of(&f, u, &value)) return;
    found(f.s, f.on, f.on->held, &f.at, which);
}

/* Values at rising u, of which those from `first` to `last` are known, LEFT and RIGHT always. */
enum { LEFT = 2, RIGHT = 3, KNOWN = 6 };
typedef struct {
    int first, last;
    double u[KNOWN], value[KNOWN];
} values;

/* How many zeros are between LEFT and RIGHT: none, one, or SEVERAL, as far as the values tell; then it is known better with
 * the value at `split`. The cubic through four values is off by the terms after it; where it has less than 0 below and more
 * above, by its coefficients of S. Bernstein (R. Farouki, The Bernstein polynomial basis, 2012), there may be several. */
enum { SEVERAL = 2 };
static int zeros_of(const values *at, double *split) {
    static const int order[KNOWN] = {LEFT, RIGHT, 1, 4, 0, 5};
    const double a = at->u[LEFT], span = at->u[RIGHT] - a, middle = 0.5 * (a + at->u[RIGHT]);
    const double sign = at->value[LEFT] > 0.0 ? 1.0 : -1.0, v0 = sign * at->value[LEFT], v1 = sign * at->value[RIGHT];
    double u[KNOWN], term[KNOWN], product = 1.0, unsure = 0.0;
    int count = 0;
    for (int k = 0; k < KNOWN; k++) {  /* Newton's divided differences */
        const int i = order[k];
        if (i < at->first || i > at->last) continue;
        double difference = sign * at->value[i];
        for (int j = 0; j < count; j++) difference = (difference - term[j]) / (at->u[i] - u[j]);
        u[count] = at->u[i], term[count] = difference, count++;
    }
    *split = middle;
    if (count == 2) return SEVERAL;
    const int terms = count - 1 < 4 ? count - 1 : 4;
    for (int k = 0; k < count; k++) {
        if (k >= terms) unsure += fabs(term[k] * product);
        product *= middle - u[k];
    }
    unsure *= UNSURE;
    const double second = terms > 2 ? term[2] : 0.0, third = terms > 3 ? term[3] : 0.0;
    const double m0 = span * (term[1] - second * span - third * span * (a - u[2 < count ? 2 : 0]));
    const double m1 = span * (term[1] + second * span + third * span * (a + span - u[2 < count ? 2 : 0]));
    const double b1 = v0 + m0 / 3.0, b2 = v1 - m1 / 3.0;
    if (v1 <= 0.0) return b1 < unsure && b2 > -unsure ? SEVERAL : 1;
    if (b1 > unsure && b2 > unsure) return 0;
    const double c2 = 3.0 * (v1 - v0) - 2.0 * m0 - m1, c3 = 2.0 * (v0 - v1) + m0 + m1, square = c2 * c2 - 3.0 * c3 * m0;
    double least = fmin(v0, v1);
    if (square > 0.0) {
        const double root = sqrt(square), x = c2 > 0.0 ? -m0 / (c2 + root) : (root - c2) / (3.0 * c3);
        if (x > 0.0 && x < 1.0) {
            least = fmin(least, v0 + x * (m0 + x * (c2 + x * c3)));
            if (x > 0.05 && x < 0.95) *split = a + x * span;
        }
    }
    return least > unsure && least > 0.5 * fmin(v0, v1) ? 0 : SEVERAL;
}

/* Put a value between LEFT and RIGHT and keep what is on one side of it. */
static values half_of(const values *at, int right, double u, double value) {
    values half;
    const int shift = right ? 1 : 0;
    half.first = at->first - shift < 0 ? 0 : at->first - shift;
    half.last = at->last + 1 - shift >= KNOWN ? KNOWN - 1 : at->last + 1 - shift;
    for (int i = half.first; i <= half.last; i++) {
        const int from = i + shift;  /* with the new one at RIGHT, and what was there after it */
        half.u[i] = from < RIGHT ? at->u[from] : from == RIGHT ? u : at->u[from - 1];
        half.value[i] = from < RIGHT ? at->value[from] : from == RIGHT ? value : at->value[from - 1];
    }
    return half;
}

/* Start from every zero between LEFT and RIGHT. */
static void start_inside(const function *on, const values *at, int *budget) {
    const double a = at->u[LEFT], b = at->u[RIGHT], value_a = at->value[LEFT], value_b = at->value[RIGHT];
    double split, value;
    const int zeros = zeros_of(at, &split);
    if (zeros == SEVERAL && b - a > APART && *budget > 0) {
        function f = *on;
        --*budget;
        if (!value_of(&f, split, &value)) return;
        for (int right = 0; right < 2; right++) {
            const values half = half_of(at, right, split, value);
            start_inside(on, &half, budget);
        }
    } else if ((value_a > 0.0) != (value_b > 0.0)) {
        start_between(on, a, value_a, b, value_b);
    }
}

/* Start from zeros between a q5 with values and the last before another, at which there are some: both sides of phi as one
 * function of the square root of the distance from there. */
static void up_to_the_end(const search *s, const condition *on, int side, double q5, double beyond, int *budget) {
    function f = {.s = s, .on = on, .side = side, .which = END};
    double inside = q5, first, outside = beyond, second, square, both[2], u[ALONG_END], value[ALONG_END];
    if (on->way != LENGTH) return;
    value_of(&f, inside, &first), value_of(&f, outside, &second);
    if (!(first > 0.0 && second < 0.0)) return;
    zero_of(&f, &inside, &first, &outside, &second);
    f.which = 0, f.end = inside, f.span = q5 - inside;
    for (int k = QUARTERS; k >= 0; k--) {
        take_at(s, q5_of(&f, (double)k / QUARTERS), side, &f.at);
        if (!(evaluate(on, &f.at, both, &square) > 0.0)) return;
        u[QUARTERS + k] = u_of(QUARTERS + k), u[QUARTERS - k] = u_of(QUARTERS - k);
        value[QUARTERS - k] = -both[1], value[QUARTERS + k] = both[0];
    }
    if ((both[0] > 0.0) == (both[1] > 0.0)) found(s, on, on->held, &f.at, 0);
    for (int k = 0; k + 1 < ALONG_END; k++) {
        values at;
        at.first = k < LEFT ? LEFT - k : 0, at.last = k + KNOWN - LEFT > ALONG_END ? ALONG_END - 1 - k + LEFT : KNOWN - 1;
        for (int i = at.first; i <= at.last; i++) {
            const int from = k + i - LEFT, last = k < QUARTERS && from == QUARTERS;
            at.u[i] = last ? -u[from] : u[from], at.value[i] = last ? -both[1] : value[from];
        }
        start_inside(&f, &at, budget);
    }
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
 * zeros may be close together. Between two others q1 only rises or falls. */
static void set_grid(search *s) {
    static const double BESIDE = 1e-4;
    const double farthest = atan2(s->five->tip[2][2], s->five->tip[1][2]);
    double c5[GRID], s5[GRID];
    s->samples = GRID;
    for (int i = 0; i < EVEN; i++) s->q5[i] = KR_TURN * (i + 0.37) / EVEN - KR_PI;
    for (int i = EVEN; i < GRID; i++) {
        const double q5 = kr_wrapped(farthest + (i & 2 ? KR_PI : 0.0) + (i & 1 ? BESIDE : -BESIDE));
        int at = i;
        for (; at > 0 && s->q5[at - 1] > q5; at--) s->q5[at] = s->q5[at - 1];
        s->q5[at] = q5;
    }
    s->q5[GRID] = s->q5[0] + KR_TURN;
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
        for (int i = 0; i < s->samples; i++) {
            const int before = i > 0 ? i - 1 : s->samples - 1, earlier = before > 0 ? before - 1 : s->samples - 1;
            const int *open = s->open[side], next = i + 1 < s->samples ? i + 1 : 0;
            const sample *at = &s->grid[side][i];
            s->needed[side][i] = at->exists && (open[i] || open[next] || open[before] || open[earlier]);
            for (int k = 0; k < 2; k++) s->x[side][k][i] = s->needed[side][i] ? at->x[k] : NAN;
            for (int k = 0; s->needed[side][i] && k < 2; k++) s->t[k][i] = at->t[k];
        }
    }
}

/* Samples from where q1 turns back to one of the grid that is WIDE away, or as far as there are some, with q1 on either side;
 * what is between samples of the grid there is not tried once more. */
static void set_ends(search *s) {
    static const double WIDE = 0.12;
    const double c = s->five->tip[1][2], n = s->five->tip[2][2], farthest = atan2(n, c), radius = hypot(c, n);
    double turn[2];
    int there[2];
    s->ends = 0;
    memset(s->covered, 0, sizeof s->covered);
    for (int k = 0; k < 2; k++) {
        const double rest = (k ? s->size : -s->size) - s->height - s->five->tip[0][2];
        there[k] = fabs(rest) < radius, turn[k] = there[k] ? acos(rest / radius) : 0.0;
    }
    for (int k = 0; k < ENDS; k++) {
        const int high = k >> 1, samples = s->samples;
        const double sign = k & 1 ? -1.0 : 1.0, into = high ? sign : -sign;
        if (!there[high]) continue;
        turning_point *end = s->end + s->ends++;
        end->q5 = kr_wrapped(farthest + sign * turn[high]);
        const double arc = there[1 - high] ? fabs(turn[0] - turn[1]) : 2.0 * (high ? KR_PI - turn[1] : turn[0]);
        int first = 0;
        double away[GRID] = {0.0};
        for (int i = 0; i < samples; i++) {
            away[i] = into * kr_wrapped(s->q5[i] - end->q5);
            if (away[i] <= 0.0) away[i] += KR_TURN;
            if (away[i] < away[first]) first = i;
        }
        end->span = into * 0.5 * arc;
        for (int i = first; away[i] < arc;) {
            const int next = (i + (into > 0.0 ? 1 : samples - 1)) % samples;
            end->span = into * away[i];
            if (away[i] > WIDE || away[next] >= arc || away[next] < away[i]) break;
            s->covered[into > 0.0 ? i : next] = 1, i = next;
        }
        const function f = {.end = end->q5, .span = end->span};
        int out[2] = {1, 1}, rolled[2] = {1, 1};
        for (int i = 0; i < ALONG_END; i++) {
            sample *at = end->at + i;
            take_at(s, q5_of(&f, u_of(i)), i < QUARTERS, at);
            const int o = s->limits && at->exists ? past(s->goal->arm, 0, at->c1, at->s1) : 0;
            const int r = s->limits ? past(s->goal->arm, 4, cos(at->q5), sin(at->q5)) : 0;
            out[0] &= o < 0, out[1] &= o > 0, rolled[0] &= r < 0, rolled[1] &= r > 0;
        }
        end->open = !(out[0] || out[1] || rolled[0] || rolled[1]);
    }
}

/* What a condition has at samples of rising u: sample i is at FIRST + i, NAN is what there is not. Around the circle the last
 * samples stand before the first, too, and the first after the last. Starts are sought between a sample and the next where
 * `open` says so. */
enum { FIRST = LEFT, PADDED = GRID + KNOWN - 1 };
typedef struct {
    int intervals, flat[2], open[GRID];
    double u[PADDED], square[PADDED], value[2][PADDED];
} course;

/* Begin with samples of which nothing is known. */
static void begin(course *of, int intervals) {
    of->intervals = intervals, of->flat[0] = of->flat[1] = 0;
    for (int i = 0; i < intervals + KNOWN - 1; i++) of->u[i] = of->square[i] = of->value[0][i] = of->value[1][i] = NAN;
}

static void close_circle(double *at, int samples, double turn) {
    for (int i = 0; i < FIRST; i++) at[i] = at[samples + i] - turn;
    for (int i = FIRST; i + 1 < KNOWN; i++) at[samples + i] = at[i] + turn;
}

/* The values around a sample and the next, as far as they are known. */
static values values_at(const course *of, const double *value, int i) {
    values at = {.first = LEFT, .last = RIGHT};
    memcpy(at.u, of->u + i, sizeof at.u), memcpy(at.value, value + i, sizeof at.value);
    while (at.first > 0 && !isnan(at.value[at.first - 1])) at.first--;
    while (at.last + 1 < KNOWN && !isnan(at.value[at.last + 1])) at.last++;
    return at;
}

/* How much farther from 0 two values are than they change around. */
static inline double excess(const double *v) {
    const double here = fabs(v[0]), there = fabs(v[1]);
    return (here < there ? here : there) - FAR * (fabs(v[0] - v[-1]) + fabs(v[1] - v[0]) + fabs(v[2] - v[1]));
}

/* Whether a value may be 0 between a sample and the next. */
static int near(const double *value, int i) {
    const double *v = value + FIRST + i;
    return !isnan(v[0]) && !isnan(v[1]) && !(excess(v) > 0.0);
}

/* Add what is not 0 where it may. */
static void mark(const course *of, const double *value, double marks[GRID]) {
    for (int i = 0; i < of->intervals; i++) {
        const double more = excess(value + FIRST + i);
        marks[i] += more > 0.0 ? 0.0 : more - 1.0;
    }
}

/* Where the root in phi is there at two samples, or at neither, it may be another way between them, and where it is at one,
 * more than once. Returns whether it is so; then starts are taken. */
static int ends_inside(const function *on, const values *at, int inner, int *budget) {
    const double a = at->u[LEFT], b = at->u[RIGHT];
    const int here = at->value[LEFT] > 0.0, there = at->value[RIGHT] > 0.0;
    double split, value;
    if (zeros_of(at, &split) == SEVERAL && b - a > APART && *budget > 0) {
        function f = *on;
        --*budget;
        value_of(&f, split, &value);
        const values low = half_of(at, 0, split, value), high = half_of(at, 1, split, value);
        const int flips = here != there || (value > 0.0) != here;
        const int before = ends_inside(on, &low, inner || flips, budget);
        return ends_inside(on, &high, inner || flips || before, budget) || before;
    }
    if (here != there) {
        int side, which;
        sides_of(on, fabs(a) > fabs(b) ? a : b, &side, &which);
        up_to_the_end(on->s, on->on, side, q5_of(on, here ? a : b), q5_of(on, here ? b : a), budget);
        return 1;
    }
    for (int which = 0; inner && here && which < 2; which++) {
        function f = *on;
        values ends = {.first = LEFT, .last = RIGHT, .u[LEFT] = a, .u[RIGHT] = b};
        f.which = which;
        if (value_of(&f, a, &ends.value[LEFT]) && value_of(&f, b, &ends.value[RIGHT])) start_inside(&f, &ends, budget);
    }
    return 0;
}

/* Start from all zeros between samples. */
static void start_along(const course *of, const function *on, int *budget) {
    const int rooted = on->on->way == LENGTH, ways = on->on->way == ALONG ? 1 : 2;
    double marks[GRID] = {0.0};
    function f = *on;
    for (int which = 0; which < ways; which++)
        if (!of->flat[which]) mark(of, of->value[which], marks);
    if (rooted) mark(of, of->square, marks);
    for (int i = 0; i < of->intervals; i++) {
        if (marks[i] == 0.0 || !of->open[i]) continue;
        if (rooted && near(of->square, i)) {
            const values at = values_at(of, of->square, i);
            f.which = END;
            if (ends_inside(&f, &at, 0, budget)) continue;
        }
        for (f.which = 0; f.which < ways; f.which++) {
            if (of->flat[f.which] || !near(of->value[f.which], i)) continue;
            const values at = values_at(of, of->value[f.which], i);
            start_inside(&f, &at, budget);
        }
    }
}

/* What `evaluate` has of a direction, at all samples at once; and how often it is none. */
static void differences(const search *s, const condition *on, int side, double *value, int *flat) {
    for (int i = 0; i < s->samples; i++) {
        const double x = s->x[side][0][i] - on->c[0], y = s->x[side][1][i] - on->c[1];
        const double u = s->t[0][i] + on->e[0], v = s->t[1][i] + on->e[1];
        value[i] = x * x + y * y - (u * u + v * v);
    }
    for (int i = 0; i < s->samples; i++) *flat += fabs(value[i]) < FLAT;
}

/* Zeros over q5 with q1 on one side. */
static void along(const search *s, const condition *on, int side, int *budget) {
    const int ways = on->way == ALONG ? 1 : 2, *open = s->open[side], samples = s->samples;
    const function f = {.s = s, .on = on, .side = side};
    double both[2];
    int tried = 0;
    course of;
    begin(&of, samples);
    memcpy(of.u + FIRST, s->q5, samples * sizeof *s->q5);
    for (int i = 0; i < samples; i++) of.open[i] = open[i] && !s->covered[i], tried += s->needed[side][i];
    if (on->way == ALONG) differences(s, on, side, of.value[0] + FIRST, of.flat);
    for (int i = 0; on->way != ALONG && i < samples; i++) {
        if (!s->needed[side][i]) continue;
        const double scale = evaluate(on, &s->grid[side][i], both, of.square + FIRST + i);
        if (!(scale > 0.0)) continue;
        for (int which = 0; which < ways; which++) {
            of.value[which][FIRST + i] = both[which];
            of.flat[which] += fabs(both[which]) < FLAT * scale;
        }
    }
    close_circle(of.u, samples, KR_TURN), close_circle(of.square, samples, 0.0);
    for (int which = 0; which < ways; which++) {
        close_circle(of.value[which], samples, 0.0);
        of.flat[which] = of.flat[which] > 2 && 4 * of.flat[which] > tried;
        if (!of.flat[which]) continue;
        /* joint 5 is free, as where the tip points along axis 1: it stays as near to where it is as it can */
        sample at;
        double there, nearest = INFINITY;
        take_at(s, s->given[4], side, &at);
        const int stays = evaluate(on, &at, both, &there) > 0.0;
        for (int i = 0; i < samples && !stays; i++) {
            const double away = fabs(kr_wrapped(s->q5[i] - s->given[4]));
            if (!isnan(of.value[which][FIRST + i]) && away < nearest) nearest = away, at = s->grid[side][i];
        }
        found(s, on, on->held, &at, which);
    }
    start_along(&of, &f, budget);
}

/* Zeros on both sides of an end of what q1 makes up for. */
static void around_end(const search *s, const condition *on, const turning_point *end, int *budget) {
    const function f = {.s = s, .on = on, .end = end->q5, .span = end->span, .turns = 1};
    const int ways = on->way == ALONG ? 1 : 2;
    double both[2];
    course of;
    begin(&of, ALONG_END - 1);
    for (int i = 0; i < ALONG_END; i++) {
        of.u[FIRST + i] = u_of(i), of.open[i] = 1;
        if (!end->at[i].exists) continue;
        const double scale = evaluate(on, end->at + i, both, of.square + FIRST + i);
        if (!(scale > 0.0)) continue;
        for (int which = 0; which < ways; which++) {
            of.value[which][FIRST + i] = i < QUARTERS ? -both[which] : both[which];
            of.flat[which] += fabs(both[which]) < FLAT * scale;
        }
    }
    for (int which = 0; which < ways; which++) of.flat[which] = of.flat[which] > 2;
    start_along(&of, &f, budget);
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
    memset(s.t, 0, sizeof s.t);
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
    set_grid(&s), set_ends(&s);
    for (int k = 0; k < count; k++) {
        int budget = BUDGET;
        s.given = given[k];
        for (int side = 0; side < 2; side++) along(&s, on + k, side, &budget);
        for (int i = 0; i < s.ends; i++)
            if (s.end[i].open) around_end(&s, on + k, s.end + i, &budget);
    }
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
