/* What a pose has to be. */
#include "core.h"

#include <math.h>

/* Entries of a rotation and the row below it are off by less where they are exact to rounding; farthest position [m]. */
static const double ROUNDING = 1e-12, MAX_DISTANCE = 1e6;

int kr_is_rigid(const double T[16]) {
    const double nx = T[0], ox = T[1], ax = T[2], ny = T[4], oy = T[5], ay = T[6], nz = T[8], oz = T[9], az = T[10];
    return fabs(nx * nx + ny * ny + nz * nz - 1.0) < ROUNDING && fabs(ox * ox + oy * oy + oz * oz - 1.0) < ROUNDING &&
           fabs(nx * ox + ny * oy + nz * oz) < ROUNDING && fabs(ny * oz - nz * oy - ax) < ROUNDING &&
           fabs(nz * ox - nx * oz - ay) < ROUNDING && fabs(nx * oy - ny * ox - az) < ROUNDING &&
           fabs(T[3]) < MAX_DISTANCE && fabs(T[7]) < MAX_DISTANCE && fabs(T[11]) < MAX_DISTANCE && T[12] == 0.0 &&
           T[13] == 0.0 && T[14] == 0.0 && T[15] == 1.0;
}
