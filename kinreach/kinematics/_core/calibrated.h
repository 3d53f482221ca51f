#ifndef KR_CALIBRATED_H
#define KR_CALIBRATED_H

#include "core.h"

/* Every posture of a pose of a calibrated UR, into rows (16, 8) by branch index; returns how many there are. `miss` gets
 * the parts that kept others from reaching. */
int kr_calibrated_postures(const kr_calibrated *arm, const double T[12], double tol, double *rows, int *miss);

#endif
