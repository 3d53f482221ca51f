/* All postures of any arm with six revolute joints, by elimination and an eigenvalue problem.
 *
 * Raghavan and Roth, Inverse kinematics of the general 6R manipulator and related linkages, Journal of Mechanical Design
 * 115, 1993, with the eigenvalues of Manocha and Canny, Efficient inverse kinematics for general 6R manipulators, IEEE
 * Transactions on Robotics and Automation 10, 1994.
 *
 * Equations. The line of joint 5's axis is computed from both ends of the closed chain, so the angle of joint 5 does not
 * occur. A line has the direction l and the point p; the fourteen functions p, l, p.p, p.l, p x l and l (p.p) - 2 p (p.l)
 * are linear in the cosine and sine of every angle. Joints 1 and 6 are eliminated linearly. Six equations in the sines
 * and cosines of joints 2, 3 and 4 remain. Multiplied by cos(q/2) and sin(q/2) of one of these joints, the factor, they
 * become twelve equations that are linear in twelve products of the factor and the third joint, and their coefficients
 * are linear in the cosine and sine of the unknown joint. That is a quadratic eigenvalue problem of size 24 in the
 * tangent of half the unknown angle. Its real eigenvalues include every posture; there are at most sixteen.
 *
 * Deflation. Eight of the 24 eigenvalues are extraneous: i and -i, four times each. If joint 2 is the unknown, their
 * vectors are the same for all poses: for large e^(iq) of that joint only the part of a line's functions that grows with
 * it counts, and at most four parts do, one of each vector p, l, p x l and l (p.p) - 2 p (p.l). One orthogonal projection
 * per arm reduces the problem to size 16.
 *
 * With the axis of joint 5 the problem is regular for arms whose axes 2 to 4 are parallel or nearly so. It is singular if
 * the first and the last axis are parallel: the pose is then tilted by TILT, which changes the eigenvalues by about as
 * much (Hochstenbach, Mehl and Plestenjak, Solving singular generalized eigenvalue problems by a rank-completing
 * perturbation, SIAM Journal on Matrix Analysis and Applications 40, 2019).
 *
 * The eigenvalues give starting points for Newton's method on the arm itself. Only postures that reach the pose are kept.
 * Where their number is in doubt, because some merge or a matrix is ill-conditioned, other joints are the unknown, too,
 * and Newton's method also starts around postures that merge. */
#include "elimination.h"

#include "chain.h"
#include "eigenvalues.h"
#include "newton.h"

#include <math.h>
#include <string.h>

enum { JOINTS = 6, FUNCTIONS = 14, PRODUCTS = 12, EXTRANEOUS = 4, REDUCED = 16, FULL = 24 };
/* Columns of what the linear elimination works on: 27 products of joints 2, 3 and 4, and the constant. */
enum { COLUMNS = 28, CONSTANT = 27, ELIMINATED = 8, EQUATIONS = 6 };
/* Starts from all choices of the unknown, postures that are compared, and random starts around those that merge. */
enum { MAX_STARTS = 160, MAX_FOUND = 320, RESTARTS = 256 };
/* Steps of Newton's method from an eigenvalue, from one that is not exact, and near a singularity. */
enum { STEPS = 6, MORE_STEPS = 12, MAX_STEPS = 40 };

/* Angle that is pi before the one with an infinite eigenvalue [rad]; arbitrary. */
static const double PHASES[2] = {0.7123, 2.0451};
/* Which of joints 2, 3, 4 (0, 1, 2) is the unknown, and which multiplies the equations. */
static const int CHOICES[3][2] = {{0, 1}, {1, 0}, {2, 1}};
/* Rotation of a pose whose last axis is closer to the first one's direction than this [rad]. */
static const double TILT = 1e-5;
/* Imaginary part up to which an eigenvalue is real, may be two that are equal, and is a start; equal ones that are well
 * conditioned have less than the second. */
static const double MAX_REAL = 1e-11, MIN_COMPLEX = 1e-4, MAX_EQUAL = 1e-2, MAX_CANDIDATE = 3e-2;
/* Eigenvalues whose angles differ by more are distinct, by less may be equal; the most by which Newton's method corrects
 * a well-conditioned one [rad]. */
static const double DISTINCT_ANGLE = 1e-4, CLUSTER_WIDTH = 0.05, MAX_CORRECTION = 1e-4;
/* A matrix with a larger entry is ill-conditioned; what is added to one before it is inverted. */
static const double MAX_ENTRY = 1e5, REGULARISATION = 1e-14;
/* Postures closer than this are the same; closer than this, if the one between them reaches the pose too; starts [rad]. */
static const double SAME = 1e-6, SAME_IF_CONNECTED = 2e-2, SAME_START = 1e-3;
/* A posture is beside a start if it is closer than this in every joint [rad]. */
static const double BESIDE = 0.2;
/* If no eigenvalue is nearly real, every posture misses the pose by more than this [m, rad]. */
static const double FAR_MISS = 1e-6;
/* Smallest singular value of the Jacobian at a posture that may have others near it. */
static const double MERGING = 1e-3;
/* cos and sin of the three angles at which functions that are linear in them are sampled. */
#define HALF_ROOT_3 0.86602540378443864676
static const double SAMPLES[3][2] = {{1.0, 0.0}, {-0.5, HALF_ROOT_3}, {-0.5, -HALF_ROOT_3}};
/* Coefficients of 1, cos and sin from the values at the samples. */
#define THIRD (1.0 / 3.0)
static const double COEFFICIENTS[3][3] = {
    {THIRD, THIRD, THIRD}, {2.0 * THIRD, -THIRD, -THIRD}, {0.0, 2.0 * THIRD * HALF_ROOT_3, -2.0 * THIRD * HALF_ROOT_3}};

/* The eigenvalue problem of one pose. */
typedef struct {
    double triangle[ELIMINATED * ELIMINATED];  /* of the products of joints 1 and 6 */
    double equations[FUNCTIONS * COLUMNS];     /* eight to find those, six without them */
} system_t;

/* Starts of Newton's method, and the imaginary parts of their eigenvalues. */
typedef struct {
    double q[FULL][JOINTS], imaginary[FULL];
    int count;
    double largest;  /* entry of the matrix; infinite if there is no solution */
} starts_t;

/* Postures that are being collected, in [-pi, pi]. */
typedef struct {
    double q[MAX_FOUND][JOINTS];
    int count;
} found_t;

/* Preparation ------------------------------------------------------------------------------------------------------- */

/* The fourteen functions of a line with direction l and point p. */
static void functions_of(const double l[3], const double p[3], double f[FUNCTIONS]) {
    const double pp = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], pl = p[0] * l[0] + p[1] * l[1] + p[2] * l[2];
    for (int k = 0; k < 3; k++) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        f[k] = p[k];
        f[3 + k] = l[k];
        f[8 + k] = p[a] * l[b] - p[b] * l[a];
        f[11 + k] = l[k] * pp - 2.0 * p[k] * pl;
    }
    f[6] = pp;
    f[7] = pl;
}

/* Multiply a motion by a turn about z with this cosine and sine. */
static void turn(double F[12], const double sample[2]) {
    const double c = sample[0], s = sample[1];
    for (int r = 0; r < 12; r += 4) {
        const double x = F[r], y = F[r + 1];
        F[r] = c * x + s * y;
        F[r + 1] = c * y - s * x;
    }
}

static void inverse(const double F[12], double back[12]) {
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++) back[4 * r + c] = F[4 * c + r];
        back[4 * r + 3] = -(F[r] * F[3] + F[4 + r] * F[7] + F[8 + r] * F[11]);
    }
}

/* Values at the three samples of one angle, `stride` apart, to coefficients; for all `count` functions. */
static void to_coefficients(double *values, int stride, int count) {
    for (int f = 0; f < count; f++) {
        double *v = values + f, x = v[0], y = v[stride], z = v[2 * stride];
        for (int k = 0; k < 3; k++)
            v[k * stride] = COEFFICIENTS[k][0] * x + COEFFICIENTS[k][1] * y + COEFFICIENTS[k][2] * z;
    }
}

/* The functions of axis 5 seen from joint 2, for its angle, joint 3's and joint 4's. */
static void prepare_near(kr_elimination *arm) {
    double values[27][FUNCTIONS];
    const double *A = arm->placements;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int d = 0; d < 3; d++) {
                double F[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, G[12], l[3], p[3];
                turn(F, SAMPLES[a]);
                kr_times(F, A + 24, G);
                turn(G, SAMPLES[b]);
                kr_times(G, A + 36, F);
                turn(F, SAMPLES[d]);
                kr_times(F, A + 48, G);
                for (int k = 0; k < 3; k++) l[k] = G[4 * k + 2], p[k] = G[4 * k + 3] / arm->size;
                functions_of(l, p, values[9 * a + 3 * b + d]);
            }
    to_coefficients(values[0], 9 * FUNCTIONS, 9 * FUNCTIONS);
    for (int k = 0; k < 27; k += 9) to_coefficients(values[k], 3 * FUNCTIONS, 3 * FUNCTIONS);
    for (int k = 0; k < 27; k += 3) to_coefficients(values[k], FUNCTIONS, FUNCTIONS);
    for (int f = 0; f < FUNCTIONS; f++)
        for (int k = 0; k < 27; k++) arm->near[27 * f + k] = values[k][f];
}

/* The factor's half angles times 1, its cosine and its sine, in (cos 3q/2, sin 3q/2, cos q/2, sin q/2): f[0] to f[2] are
 * the coefficients of 1, cosine and sine, `half` is 0 for cos(q/2) and 1 for sin(q/2). */
static void by_half_angle(int half, const double f[3], double products[4]) {
    products[0] = half ? -0.5 * f[2] : 0.5 * f[1];
    products[1] = half ? 0.5 * f[1] : 0.5 * f[2];
    products[2] = half ? 0.5 * f[2] : f[0] + 0.5 * f[1];
    products[3] = half ? f[0] - 0.5 * f[1] : 0.5 * f[2];
}

/* The part that is left of the eigenvalue problem if joint 2 is the unknown.
 *
 * The extraneous vectors are the kernel of a complex matrix (28, 12). A QR factorisation of its adjoint, with column
 * pivoting, has eight columns that span the rest. */
static void prepare_deflation(kr_elimination *arm) {
    enum { ROWS = PRODUCTS, COLS = 2 * FUNCTIONS, RANK = PRODUCTS - EXTRANEOUS };
    double re[COLS][ROWS], im[COLS][ROWS], vre[RANK][ROWS] = {{0}}, vim[RANK][ROWS] = {{0}};
    for (int f = 0; f < FUNCTIONS; f++)
        for (int half = 0; half < 2; half++)
            for (int third = 0; third < 3; third++) {
                const double *c = arm->near + 27 * f + 9 + third, *s = c + 9;
                double x[4], y[4];
                by_half_angle(half, (const double[3]){c[0], c[3], c[6]}, x);
                by_half_angle(half, (const double[3]){s[0], s[3], s[6]}, y);
                for (int k = 0; k < 4; k++) re[2 * f + half][3 * k + third] = x[k], im[2 * f + half][3 * k + third] = -y[k];
            }
    for (int k = 0; k < RANK; k++) {
        int pivot = k;
        double most = -1.0;
        for (int j = k; j < COLS; j++) {
            double s = 0.0;
            for (int i = k; i < ROWS; i++) s += re[j][i] * re[j][i] + im[j][i] * im[j][i];
            if (s > most) most = s, pivot = j;
        }
        for (int i = 0; i < ROWS; i++) {
            double t = re[k][i];
            re[k][i] = re[pivot][i], re[pivot][i] = t;
            t = im[k][i];
            im[k][i] = im[pivot][i], im[pivot][i] = t;
        }
        /* Householder: v = x + e^(i arg x0) |x| e0, normalised */
        double norm = sqrt(fmax(most, 0.0)), head = hypot(re[k][k], im[k][k]), length = 0.0;
        for (int i = k; i < ROWS; i++) vre[k][i] = re[k][i], vim[k][i] = im[k][i];
        vre[k][k] += head > 0.0 ? norm * re[k][k] / head : norm;
        vim[k][k] += head > 0.0 ? norm * im[k][k] / head : 0.0;
        for (int i = k; i < ROWS; i++) length += vre[k][i] * vre[k][i] + vim[k][i] * vim[k][i];
        if (!(length > 0.0)) vre[k][k] = length = 1.0;
        for (int i = k; i < ROWS; i++) vre[k][i] /= sqrt(length), vim[k][i] /= sqrt(length);
        for (int j = k + 1; j < COLS; j++) {
            double x = 0.0, y = 0.0;
            for (int i = k; i < ROWS; i++) {
                x += vre[k][i] * re[j][i] + vim[k][i] * im[j][i];
                y += vre[k][i] * im[j][i] - vim[k][i] * re[j][i];
            }
            for (int i = k; i < ROWS; i++) {
                re[j][i] -= 2.0 * (vre[k][i] * x - vim[k][i] * y);
                im[j][i] -= 2.0 * (vre[k][i] * y + vim[k][i] * x);
            }
        }
    }
    for (int column = 0; column < RANK; column++) {
        double qre[ROWS] = {0}, qim[ROWS] = {0};
        qre[column] = 1.0;
        for (int k = RANK - 1; k >= 0; k--) {
            double x = 0.0, y = 0.0;
            for (int i = k; i < ROWS; i++) {
                x += vre[k][i] * qre[i] + vim[k][i] * qim[i];
                y += vre[k][i] * qim[i] - vim[k][i] * qre[i];
            }
            for (int i = k; i < ROWS; i++) {
                qre[i] -= 2.0 * (vre[k][i] * x - vim[k][i] * y);
                qim[i] -= 2.0 * (vre[k][i] * y + vim[k][i] * x);
            }
        }
        for (int i = 0; i < ROWS; i++) {
            arm->rest[REDUCED * i + column] = qre[i];
            arm->rest[REDUCED * i + RANK + column] = qim[i];
            arm->rest[REDUCED * (ROWS + i) + column] = -qim[i];
            arm->rest[REDUCED * (ROWS + i) + RANK + column] = qre[i];
        }
    }
    memset(arm->constant, 0, sizeof arm->constant);
    for (int i = 0; i < ROWS; i++)
        for (int k = 0; k < REDUCED; k++)
            for (int j = 0; j < REDUCED; j++)
                arm->constant[REDUCED * k + j] += arm->rest[REDUCED * i + k] * arm->rest[REDUCED * (ROWS + i) + j];
}

void kr_elimination_prepare(const double placements[84], kr_elimination *arm) {
    const double *A = arm->placements;
    memcpy(arm->placements, placements, sizeof arm->placements);
    arm->size = 0.0;
    for (int i = 1; i <= JOINTS; i++)
        for (int r = 0; r < 3; r++) arm->size = fmax(arm->size, fabs(A[12 * i + 4 * r + 3]));
    for (int a = 0; a < 3; a++) {
        double F[12], G[12];
        memcpy(F, A, sizeof F);
        turn(F, SAMPLES[a]);
        kr_times(F, A + 12, G);
        inverse(G, arm->left + 12 * a);
        memcpy(F, A + 60, sizeof F);
        turn(F, SAMPLES[a]);
        kr_times(F, A + 72, G);
        inverse(G, F);
        for (int r = 0; r < 3; r++) {
            arm->right[6 * a + 2 * r] = F[4 * r + 2];
            arm->right[6 * a + 2 * r + 1] = F[4 * r + 3];
        }
    }
    prepare_near(arm);
    prepare_deflation(arm);
    arm->spurious_count = arm->singular = 0;
}

/* The eigenvalue problem of a pose ---------------------------------------------------------------------------------- */

/* The pose, tilted where the last axis is parallel to the first. */
static void tilted(const kr_elimination *arm, const double T[12], double found[12]) {
    const double *A = arm->placements, *B = A + 72;
    const double x[3] = {A[0], A[4], A[8]}, c = cos(TILT), s = sin(TILT);
    double last[3], most = 0.0;
    memcpy(found, T, 12 * sizeof *found);
    for (int i = 0; i < 3; i++) last[i] = T[4 * i] * B[8] + T[4 * i + 1] * B[9] + T[4 * i + 2] * B[10];
    for (int i = 0; i < 3; i++) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        most = fmax(most, fabs(A[4 * a + 2] * last[b] - A[4 * b + 2] * last[a]));
    }
    if (most >= TILT) return;
    for (int k = 0; k < 3; k++) {  /* about the x axis of A0 */
        const double y[3] = {T[k], T[4 + k], T[8 + k]}, along = (1.0 - c) * (x[0] * y[0] + x[1] * y[1] + x[2] * y[2]);
        for (int i = 0; i < 3; i++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3;
            found[4 * i + k] = c * y[i] + s * (x[a] * y[b] - x[b] * y[a]) + along * x[i];
        }
    }
}

/* The functions of axis 5 through joints 1 and 6: coefficients of their nine products (9, 14). */
static void far_functions(const kr_elimination *arm, const double T[12], double far[9 * FUNCTIONS]) {
    for (int a = 0; a < 3; a++) {
        double M[12];
        kr_times(arm->left + 12 * a, T, M);
        for (int b = 0; b < 3; b++) {
            const double *right = arm->right + 6 * b;
            double l[3], p[3];
            for (int r = 0; r < 3; r++) {
                const double *m = M + 4 * r;
                l[r] = m[0] * right[0] + m[1] * right[2] + m[2] * right[4];
                p[r] = (m[0] * right[1] + m[1] * right[3] + m[2] * right[5] + m[3]) / arm->size;
            }
            functions_of(l, p, far + FUNCTIONS * (3 * a + b));
        }
    }
    to_coefficients(far, 3 * FUNCTIONS, 3 * FUNCTIONS);
    for (int a = 0; a < 3; a++) to_coefficients(far + 3 * FUNCTIONS * a, FUNCTIONS, FUNCTIONS);
}

/* Eliminate joints 1 and 6 from the fourteen equations, by Householder's QR factorisation. */
static void eliminate(const kr_elimination *arm, const double T[12], system_t *system) {
    double far[9 * FUNCTIONS], A[FUNCTIONS][ELIMINATED], (*Y)[COLUMNS] = (double (*)[COLUMNS])system->equations;
    far_functions(arm, T, far);
    for (int i = 0; i < FUNCTIONS; i++) {
        for (int j = 0; j < ELIMINATED; j++) A[i][j] = far[FUNCTIONS * (j + 1) + i];
        for (int j = 0; j < CONSTANT; j++) Y[i][j] = arm->near[27 * i + j];
        Y[i][CONSTANT] = far[i];
    }
    for (int k = 0; k < ELIMINATED; k++) {
        double v[FUNCTIONS], dots[COLUMNS] = {0}, square = 0.0;
        for (int i = k; i < FUNCTIONS; i++) {
            v[i] = A[i][k];
            square += v[i] * v[i];
        }
        const double size = sqrt(square);
        if (!(size > 0.0)) continue;
        const double beta = 1.0 / (size * (size + fabs(v[k])));
        v[k] += v[k] >= 0.0 ? size : -size;
        for (int j = k; j < ELIMINATED; j++) {
            double d = 0.0;
            for (int i = k; i < FUNCTIONS; i++) d += v[i] * A[i][j];
            for (int i = k; i < FUNCTIONS; i++) A[i][j] -= beta * d * v[i];
        }
        for (int i = k; i < FUNCTIONS; i++)
            for (int j = 0; j < COLUMNS; j++) dots[j] += v[i] * Y[i][j];
        for (int i = k; i < FUNCTIONS; i++) {
            const double f = beta * v[i];
            for (int j = 0; j < COLUMNS; j++) Y[i][j] -= f * dots[j];
        }
    }
    for (int i = 0; i < ELIMINATED; i++)
        for (int j = 0; j < ELIMINATED; j++) system->triangle[ELIMINATED * i + j] = j >= i ? A[i][j] : 0.0;
    for (int i = 0; i < FUNCTIONS; i++) Y[i][0] -= Y[i][CONSTANT];
}

/* Coefficients of 1, cosine and sine of the unknown joint, of twelve equations in twelve products. */
static void in_unknown(const system_t *system, int unknown, int factor, double P[3][PRODUCTS][PRODUCTS]) {
    static const int STRIDES[3] = {9, 3, 1};
    const int third = STRIDES[3 - unknown - factor], step = STRIDES[factor];
    for (int e = 0; e < EQUATIONS; e++)
        for (int u = 0; u < 3; u++)
            for (int t = 0; t < 3; t++) {
                const double *f = system->equations + COLUMNS * (ELIMINATED + e) + STRIDES[unknown] * u + third * t;
                for (int half = 0; half < 2; half++) {
                    double products[4];
                    by_half_angle(half, (const double[3]){f[0], f[step], f[2 * step]}, products);
                    for (int k = 0; k < 4; k++) P[u][EQUATIONS * half + e][3 * k + t] = products[k];
                }
            }
}

/* LU factorisation (12, 12) with row pivoting, in place; pivots that are 0 become tiny. */
static void factored(double A[PRODUCTS][PRODUCTS], int pivots[PRODUCTS]) {
    for (int k = 0; k < PRODUCTS; k++) {
        int p = k;
        for (int i = k + 1; i < PRODUCTS; i++)
            if (fabs(A[i][k]) > fabs(A[p][k])) p = i;
        pivots[k] = p;
        if (p != k)
            for (int j = 0; j < PRODUCTS; j++) {
                const double t = A[k][j];
                A[k][j] = A[p][j], A[p][j] = t;
            }
        if (fabs(A[k][k]) < 1e-15) A[k][k] = 1e-15;
        const double inverse = 1.0 / A[k][k];
        for (int i = k + 1; i < PRODUCTS; i++) {
            const double f = A[i][k] * inverse;
            A[i][k] = f;
            for (int j = k + 1; j < PRODUCTS; j++) A[i][j] -= f * A[k][j];
        }
    }
}

static void substituted(double A[PRODUCTS][PRODUCTS], const int pivots[PRODUCTS], double b[PRODUCTS]) {
    for (int k = 0; k < PRODUCTS; k++) {
        const double x = b[pivots[k]];
        b[pivots[k]] = b[k], b[k] = x;
        for (int i = k + 1; i < PRODUCTS; i++) b[i] -= A[i][k] * x;
    }
    for (int k = PRODUCTS - 1; k >= 0; k--) {
        double x = b[k];
        for (int j = k + 1; j < PRODUCTS; j++) x -= A[k][j] * b[j];
        b[k] = x / A[k][k];
    }
}

/* The twelve products that solve (lead x + mid) x + low, by inverse iteration; `start` tells equal eigenvalues apart. */
static void products_of(double x, double lead[PRODUCTS][PRODUCTS], double mid[PRODUCTS][PRODUCTS],
                        double low[PRODUCTS][PRODUCTS], int start, double v[PRODUCTS]) {
    double N[PRODUCTS][PRODUCTS];
    int pivots[PRODUCTS];
    if (fabs(x) > 1.0) {
        const double y = 1.0 / x;
        for (int i = 0; i < PRODUCTS; i++)
            for (int j = 0; j < PRODUCTS; j++) N[i][j] = lead[i][j] + (mid[i][j] + low[i][j] * y) * y;
    } else {
        for (int i = 0; i < PRODUCTS; i++)
            for (int j = 0; j < PRODUCTS; j++) N[i][j] = (lead[i][j] * x + mid[i][j]) * x + low[i][j];
    }
    factored(N, pivots);
    for (int i = 0; i < PRODUCTS; i++) v[i] = 1.0 + 0.37 * ((i * (start + 3)) % 7);
    for (int k = 0; k < 2; k++) {
        double norm = 0.0;
        substituted(N, pivots, v);
        for (int i = 0; i < PRODUCTS; i++) norm = fmax(norm, fabs(v[i]));
        for (int i = 0; i < PRODUCTS; i++) v[i] /= norm;
    }
}

/* Fill in joints 1 and 6 of a posture by the equations that eliminate them, then joint 5. */
static void close_loop(const kr_elimination *arm, const double T[12], const system_t *system, double q[JOINTS]) {
    double products[27], s[ELIMINATED], F[12 * (JOINTS + 1)], w[2][2] = {{0}};
    const double *A = arm->placements;
    for (int a = 0, k = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            for (int d = 0; d < 3; d++, k++) {
                const int which[3] = {a, b, d};
                products[k] = 1.0;
                for (int j = 0; j < 3; j++)
                    if (which[j]) products[k] *= which[j] == 1 ? cos(q[1 + j]) : sin(q[1 + j]);
            }
    for (int i = ELIMINATED - 1; i >= 0; i--) {
        const double *y = system->equations + COLUMNS * i, *r = system->triangle + ELIMINATED * i;
        double x = 0.0;
        for (int k = 0; k < 27; k++) x += y[k] * products[k];
        for (int j = i + 1; j < ELIMINATED; j++) x -= r[j] * s[j];
        s[i] = r[i] != 0.0 ? x / r[i] : 0.0;
    }
    q[0] = atan2(s[5], s[2]);
    q[5] = atan2(s[1], s[0]);
    q[4] = 0.0;
    /* joint 5 turns what is behind joint 4 to what the pose leaves for it: (T (A5 R6 A6)^-1)^-1, two columns */
    kr_frames(JOINTS, A, q, F);
    double tail[12], turned[12];
    memcpy(turned, A + 60, sizeof turned);
    turn(turned, (const double[2]){cos(q[5]), sin(q[5])});
    kr_times(turned, A + 72, tail);
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < 3; i++) {
            const double x = T[4 * i] * tail[4 * c] + T[4 * i + 1] * tail[4 * c + 1] + T[4 * i + 2] * tail[4 * c + 2];
            for (int r = 0; r < 2; r++) w[r][c] += F[48 + 4 * i + r] * x;
        }
    q[4] = atan2(w[1][0] - w[0][1], w[0][0] + w[1][1]);
}

/* Joints 2, 3 and 4 from the unknown's tangent of half the angle and the products, an outer product (4, 3) whose largest
 * row and column are the most accurate. */
static void from_products(double tangent, const double v[PRODUCTS], int unknown, int factor, double phase, double q[JOINTS]) {
    int row = 0, column = 0;
    double rows[4] = {0}, columns[3] = {0};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 3; j++) {
            rows[i] += fabs(v[3 * i + j]);
            columns[j] += fabs(v[3 * i + j]);
        }
    for (int i = 1; i < 4; i++)
        if (rows[i] > rows[row]) row = i;
    for (int j = 1; j < 3; j++)
        if (columns[j] > columns[column]) column = j;
    const double c = v[6 + column], s = v[9 + column], one = v[3 * row] >= 0.0 ? 1.0 : -1.0;
    const double sign = (fabs(c) > fabs(s) ? c : s) >= 0.0 ? 1.0 : -1.0;
    q[1 + unknown] = phase + 2.0 * atan(tangent);
    q[1 + factor] = 2.0 * atan2(sign * s, sign * c);
    q[1 + 3 - unknown - factor] = atan2(one * v[3 * row + 2], one * v[3 * row + 1]);
}

/* The matrix (n, n) of the eigenvalue problem, of size 16 if joint 2 is the unknown, else of 24. Returns its largest entry
 * that depends on the pose; NaN or infinite if the matrix is. */
static double companion(const kr_elimination *arm, int unknown, double lead[PRODUCTS][PRODUCTS],
                        double mid[PRODUCTS][PRODUCTS], double low[PRODUCTS][PRODUCTS], double M[FULL * FULL]) {
    const int n = unknown == 0 ? REDUCED : FULL;
    double regular[PRODUCTS * PRODUCTS], image[PRODUCTS * FULL], most = 0.0;
    memcpy(regular, lead, sizeof regular);
    for (int i = 0; i < PRODUCTS; i++) {
        double *to = image + n * i;
        regular[(PRODUCTS + 1) * i] += REGULARISATION;
        for (int j = 0; j < n; j++) to[j] = 0.0;
        for (int k = 0; k < PRODUCTS; k++)
            if (unknown == 0) {
                const double *first = arm->rest + REDUCED * k, *second = first + REDUCED * PRODUCTS;
                for (int j = 0; j < REDUCED; j++) to[j] -= low[i][k] * first[j] + mid[i][k] * second[j];
            } else {
                to[k] = -low[i][k];
                to[PRODUCTS + k] = -mid[i][k];
            }
    }
    if (kr_solve(PRODUCTS, n, regular, image) == 0.0) return INFINITY;
    for (int i = 0; i < PRODUCTS * n; i++)
        if (!(fabs(image[i]) <= most)) most = fabs(image[i]);
    if (unknown == 0) {
        memcpy(M, arm->constant, sizeof arm->constant);
        for (int i = 0; i < PRODUCTS; i++)
            for (int k = 0; k < REDUCED; k++) {
                const double f = arm->rest[REDUCED * (PRODUCTS + i) + k];
                for (int j = 0; j < REDUCED; j++) M[REDUCED * k + j] += f * image[REDUCED * i + j];
            }
    } else {
        memset(M, 0, PRODUCTS * FULL * sizeof *M);
        for (int i = 0; i < PRODUCTS; i++) M[FULL * i + PRODUCTS + i] = 1.0;
        memcpy(M + PRODUCTS * FULL, image, sizeof image);
    }
    return most;
}

/* Starts of Newton's method from the eigenvalues with imaginary parts less than `limit`. */
static void find_starts(const kr_elimination *arm, const double T[12], const system_t *system, const int choice[2],
                        double phase, double limit, starts_t *starts) {
    const int unknown = choice[0], factor = choice[1], n = unknown == 0 ? REDUCED : FULL;
    const double c = cos(phase), s = sin(phase);
    double P[3][PRODUCTS][PRODUCTS], lead[PRODUCTS][PRODUCTS], low[PRODUCTS][PRODUCTS], mid[PRODUCTS][PRODUCTS];
    double M[FULL * FULL], real[FULL], imaginary[FULL];
    starts->count = 0;
    in_unknown(system, unknown, factor, P);
    for (int i = 0; i < PRODUCTS; i++)
        for (int j = 0; j < PRODUCTS; j++) {
            const double x = c * P[1][i][j] + s * P[2][i][j], y = c * P[2][i][j] - s * P[1][i][j];
            lead[i][j] = P[0][i][j] - x;
            low[i][j] = P[0][i][j] + x;
            mid[i][j] = 2.0 * y;
        }
    starts->largest = companion(arm, unknown, lead, mid, low, M);
    if (!(starts->largest < INFINITY) || !kr_eigenvalues(n, M, real, imaginary)) {
        starts->largest = INFINITY;
        return;
    }
    for (int k = 0; k < n; k++) {
        const double x = real[k], y = imaginary[k], scale = 1.0 + x * x + y * y;
        if (!(0.0 <= y && y < limit * scale && scale < INFINITY)) continue;
        double v[PRODUCTS], *q = starts->q[starts->count];
        products_of(x, lead, mid, low, k, v);
        from_products(x, v, unknown, factor, phase, q);
        close_loop(arm, T, system, q);
        starts->imaginary[starts->count++] = y / scale;
    }
}

/* Postures ---------------------------------------------------------------------------------------------------------- */

/* Largest difference of any joint modulo full turns. */
static double apart(const double a[JOINTS], const double b[JOINTS]) {
    double most = 0.0;
    for (int j = 0; j < JOINTS; j++) most = fmax(most, fabs(kr_wrapped(a[j] - b[j])));
    return most;
}

/* Add a posture, unless it is among the others. */
static void keep(found_t *found, const double q[JOINTS]) {
    double *to = found->q[found->count];
    for (int j = 0; j < JOINTS; j++) to[j] = kr_wrapped(q[j]);
    for (int i = 0; i < found->count; i++)
        if (apart(to, found->q[i]) < SAME) return;
    if (found->count < MAX_FOUND - 1) found->count++;
}

/* Drop postures that are close to an earlier one if the one between them reaches the pose, too. */
static void merge(const kr_elimination *arm, const double T[12], found_t *found) {
    const double *A = arm->placements;
    int same[MAX_FOUND], kept = 0;
    for (int i = 0; i < found->count; i++) {
        same[i] = 0;
        for (int k = 0; k < i && !same[i]; k++) {
            double middle[JOINTS];
            const double *a = found->q[i], *b = found->q[k];
            if (!(apart(a, b) < SAME_IF_CONNECTED)) continue;
            for (int j = 0; j < JOINTS; j++) middle[j] = b[j] + 0.5 * kr_wrapped(a[j] - b[j]);
            const double ends = fmax(kr_missed(A, T, a), kr_missed(A, T, b));
            same[i] = kr_missed(A, T, middle) < 4.0 * ends + 1e-13;
        }
    }
    for (int i = 0; i < found->count; i++)
        if (!same[i]) {
            if (kept < i) memcpy(found->q[kept], found->q[i], sizeof found->q[0]);
            kept++;
        }
    found->count = kept;
}

static int among(const double angles[], int count, double angle, double distance) {
    int near = 0;
    for (int i = 0; i < count; i++) near += fabs(kr_wrapped(angles[i] - angle)) < distance;
    return near;
}

/* Postures from the eigenvalues of joint 2. Returns whether their number may differ from the number that was found; then
 * `late` has the starts from which Newton's method has not arrived.
 *
 * Postures appear and vanish in pairs, and each has a real eigenvalue. One of k equal eigenvalues is accurate to the k-th
 * root of the rounding error only: it may belong to a posture although it is not real, if it is nearly real or in a
 * cluster. Then Newton's method from there comes to that posture, or comes near slowly, or goes to another one beside. */
static int from_distinct(const kr_elimination *arm, const double T[12], double tol, const starts_t *starts, found_t *found,
                         double late[][JOINTS], int *late_count) {
    double angles[FULL];
    int real = 0, doubt = !(starts->largest < MAX_ENTRY), count = 0, which[FULL];
    for (int k = 0; k < starts->count; k++) {
        double q[JOINTS], missed = INFINITY;
        const double *start = starts->q[k], angle = kr_wrapped(start[1]);
        const int is_real = starts->imaginary[k] <= MAX_REAL;
        memcpy(q, start, sizeof q);
        if (starts->imaginary[k] < MIN_COMPLEX) missed = kr_newton(arm->placements, T, STEPS, q);
        if (missed < KR_EXACT) {
            if (is_real && fabs(kr_wrapped(q[1] - angle)) > MAX_CORRECTION) doubt = 1;
            keep(found, q);
        } else {
            if (among(arm->spurious, arm->spurious_count, angle, DISTINCT_ANGLE)) continue;
            if (is_real) doubt = 1;
            memcpy(late[(*late_count)++], start, sizeof q);
        }
        real += is_real;
        angles[count] = angle;
        which[count++] = k;
    }
    if (!doubt && !arm->singular && !count && tol <= FAR_MISS) return 0;
    if (doubt || arm->singular || found->count == 0 || found->count % 2 || found->count != real) return 1;
    for (int i = 0; i < count; i++) {
        const double imaginary = starts->imaginary[which[i]];
        if (imaginary <= MAX_REAL) continue;
        if (imaginary < MIN_COMPLEX) return 1;
        const int near = among(angles, count, angles[i], CLUSTER_WIDTH);
        if (near < 2 && imaginary > MAX_EQUAL) continue;
        double q[JOINTS];
        const double *start = starts->q[which[i]];
        memcpy(q, start, sizeof q);
        const double missed = kr_newton(arm->placements, T, MORE_STEPS, q);
        const int before = found->count;
        if (missed < KR_EXACT) keep(found, q);
        if (found->count > before || (KR_EXACT <= missed && missed < FAR_MISS)) return 1;
        if (missed < KR_EXACT && near > 2 && apart(q, start) < BESIDE) return 1;
    }
    return 0;
}

/* A random number in [0, 1), the same on every machine. */
static double uniform(unsigned long long *state) {
    *state = *state * 6364136223846793005ULL + 1442695040888963407ULL;
    return (double)(*state >> 11) / 9007199254740992.0;
}

/* Newton's method from around postures that may merge with others. */
static void search_around(const kr_elimination *arm, const double T[12], found_t *found) {
    double merging[MAX_FOUND][JOINTS];
    int count = 0;
    unsigned long long state = 1;
    for (int i = 0; i < found->count; i++)
        if (kr_least_singular_value(arm->placements, found->q[i]) < MERGING)
            memcpy(merging[count++], found->q[i], sizeof merging[0]);
    if (!count) return;
    for (int k = 0; k < RESTARTS; k++) {
        double q[JOINTS];
        const double width = 3.0 * pow(10.0, -4.0 + 2.5 * uniform(&state));
        for (int j = 0; j < JOINTS; j++) q[j] = merging[k % count][j] + width * (2.0 * uniform(&state) - 1.0);
        if (kr_newton(arm->placements, T, MAX_STEPS, q) < KR_EXACT) keep(found, q);
    }
    merge(arm, T, found);
}

/* All postures near a singularity: all choices of the unknown, slow convergence, and starts around what merges. */
static void near_singular(const kr_elimination *arm, const double T[12], const double regular[12], const system_t *system,
                          double tol, double late[][JOINTS], int late_count, found_t *found) {
    found_t near;
    double missed[MAX_STARTS];
    int distinct = 0;
    near.count = 0;
    for (int k = 0, end = late_count; k < end; k++) {
        double q[JOINTS];
        memcpy(q, late[k], sizeof q);
        if (kr_newton(arm->placements, T, MORE_STEPS, q) < KR_EXACT) keep(found, q);
    }
    for (int choice = 0; choice < 3; choice++)
        for (int phase = choice == 0; phase < 2; phase++) {
            starts_t starts;
            find_starts(arm, regular, system, CHOICES[choice], PHASES[phase], MAX_CANDIDATE, &starts);
            for (int k = 0; k < starts.count; k++) {
                double q[JOINTS];
                memcpy(q, starts.q[k], sizeof q);
                if (kr_newton(arm->placements, T, MORE_STEPS, q) < KR_EXACT)
                    keep(found, q);
                else if (late_count < MAX_STARTS)
                    memcpy(late[late_count++], starts.q[k], sizeof q);
            }
        }
    for (int k = 0; k < late_count; k++) {
        int known = 0;
        for (int i = 0; i < distinct && !known; i++) known = apart(late[i], late[k]) < SAME_START;
        if (!known && distinct < k) memcpy(late[distinct], late[k], sizeof late[0]);
        distinct += !known;
    }
    for (int k = 0; k < distinct; k++) {
        const double off = kr_damped_newton(arm->placements, T, MAX_STEPS, late[k]);
        if (off < KR_EXACT)
            keep(found, late[k]);
        else if (off <= tol) {  /* the nearest first */
            int at = near.count++;
            for (; at > 0 && missed[at - 1] > off; at--) {
                missed[at] = missed[at - 1];
                memcpy(near.q[at], near.q[at - 1], sizeof near.q[0]);
            }
            missed[at] = off;
            memcpy(near.q[at], late[k], sizeof near.q[0]);
        }
    }
    merge(arm, T, found);
    if (found->count) {
        search_around(arm, T, found);
        return;
    }
    for (int k = 0; k < near.count; k++) {
        int known = 0;
        for (int i = 0; i < found->count && !known; i++) known = apart(found->q[i], near.q[k]) < SAME_IF_CONNECTED;
        if (!known) keep(found, near.q[k]);
    }
}

int kr_eliminated(const kr_elimination *arm, const double T[12], double tol, double *q, int *hard) {
    double regular[12], late[MAX_STARTS][JOINTS];
    system_t system;
    starts_t starts;
    found_t found;
    int late_count = 0;
    found.count = 0;
    tilted(arm, T, regular);
    eliminate(arm, regular, &system);
    find_starts(arm, regular, &system, CHOICES[0], PHASES[0], MAX_CANDIDATE, &starts);
    const int doubt = from_distinct(arm, T, tol, &starts, &found, late, &late_count);
    if (doubt)
        near_singular(arm, T, regular, &system, tol, late, late_count, &found);
    else
        merge(arm, T, &found);
    if (hard) *hard = doubt;
    const int count = found.count < KR_MAX_POSTURES ? found.count : KR_MAX_POSTURES;
    memcpy(q, found.q, count * sizeof found.q[0]);
    return count;
}

int kr_elimination_rows(const kr_elimination *arm, const double T[12], double tol, double *rows) {
    double q[KR_MAX_POSTURES * JOINTS];
    const int count = kr_eliminated(arm, T, tol, q, NULL);
    for (int i = 0; i < count; i++) {
        double *row = rows + (JOINTS + 2) * i;
        row[0] = i, row[1] = 0.0;
        memcpy(row + 2, q + JOINTS * i, JOINTS * sizeof *q);
    }
    return count;
}

void kr_elimination_postures(const kr_elimination *arm, const double *T, int count, double tol, double *q, int *counts,
                             int *hard) {
    for (int i = 0; i < count; i++)
        counts[i] = kr_eliminated(arm, T + 16 * i, tol, q + KR_MAX_POSTURES * JOINTS * i, hard ? hard + i : NULL);
}

int kr_elimination_starts(const kr_elimination *arm, const double *T, int count, double most, double *q,
                          double *imaginary, long long *pose) {
    int total = 0;
    for (int i = 0; i < count; i++) {
        double regular[12];
        system_t system;
        starts_t starts;
        tilted(arm, T + 16 * i, regular);
        eliminate(arm, regular, &system);
        find_starts(arm, regular, &system, CHOICES[0], PHASES[0], most, &starts);
        for (int k = 0; k < starts.count; k++, total++) {
            memcpy(q + JOINTS * total, starts.q[k], sizeof starts.q[0]);
            imaginary[total] = starts.imaginary[k];
            pose[total] = i;
        }
    }
    return total;
}
