/* The root of the hand turns on a circle about its tip. Where the links reach neither the nearest point of that circle nor
 * the farthest one, what they reach of it is two arcs, bounded by arccosines. */
#include "pitches.h"

#include "chain.h"

#include <math.h>

static double clamp(double x) { return x < -1.0 ? -1.0 : x > 1.0 ? 1.0 : x; }

int kr_pitches(double wanted, double u, double v, double hand, double hand_angle, double stretched, double folded,
               kr_pitch arcs[2]) {
    const double eta = kr_wrapped(wanted + hand_angle - atan2(v, u) + KR_PI), distance = sqrt(u * u + v * v);
    const double scale = 2.0 * distance * hand, rest = distance * distance + hand * hand;
    double lower = 0.0, upper = KR_PI; /* of |eta|, which is 0 where the hand's root is farthest from the links' */
    if (!(fabs(scale) < 1e-12)) {
        lower = acos(clamp((stretched * stretched - rest) / scale));
        upper = acos(clamp((folded * folded - rest) / scale));
    }
    const double on_arc = fmin(fmax(fabs(eta), lower), upper);
    const double nearest = on_arc == fabs(eta) ? eta : copysign(on_arc, eta);
    const int apart = lower > 0.0 && upper < KR_PI;
    arcs[0].side = apart && nearest < 0.0 ? 2 : 0;
    arcs[0].pitch = wanted + (nearest - eta);
    arcs[0].flags = nearest != eta ? KR_WRIST | KR_MOVED : KR_WRIST;
    if (!apart) return 1;
    const double other = fabs(eta) + lower < 2.0 * KR_PI - fabs(eta) - upper ? lower : upper;
    arcs[1].side = 2 - arcs[0].side;
    arcs[1].pitch = wanted - copysign(other, nearest) - eta;
    arcs[1].flags = KR_WRIST | KR_MOVED;
    return 2;
}
