#include "rows.h"

#include <math.h>
#include <string.h>

enum { WIDTH = 8 };

void kr_sort_by_branch(double *rows, int count) {
    double row[WIDTH];
    for (int i = 1; i < count; i++) {
        int k = i;
        memcpy(row, rows + WIDTH * i, sizeof row);
        for (; k > 0 && rows[WIDTH * (k - 1)] > row[0]; k--) memcpy(rows + WIDTH * k, rows + WIDTH * (k - 1), sizeof row);
        memcpy(rows + WIDTH * k, row, sizeof row);
    }
}

void kr_by_branch(int n, int branches, const double *rows, int count, double *q, unsigned char *valid) {
    memset(valid, 0, branches);
    for (int k = 0; k < branches * n; k++) q[k] = NAN;
    for (int k = 0; k < count; k++) {
        const double *row = rows + (n + 2) * k;
        const int branch = (int)row[0];
        valid[branch] = 1;
        memcpy(q + n * branch, row + 2, n * sizeof *q);
    }
}
