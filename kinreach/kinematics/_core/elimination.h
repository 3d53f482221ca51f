#ifndef KR_ELIMINATION_H
#define KR_ELIMINATION_H

#include "core.h"

enum { KR_MAX_POSTURES = 16 };

/* Every posture of a pose, given by its three upper rows, into q (16, 6); returns how many. As `kr_elimination_postures`. */
int kr_eliminated(const kr_elimination *arm, const double T[12], double tol, double *q, int *hard);

/* The same as rows (16, 8); each one's branch index is its place. */
int kr_elimination_rows(const kr_elimination *arm, const double T[12], double tol, double *rows);

#endif
