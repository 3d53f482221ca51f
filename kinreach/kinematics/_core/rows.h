/* Rows of postures: branch index, flags and n angles. */
#ifndef KR_ROWS_H
#define KR_ROWS_H

/* Sort rows of six joints by their branch index. */
void kr_sort_by_branch(double *rows, int count);

/* Rows by branch: q (branches, n), NaN where there is none, and which there are. */
void kr_by_branch(int n, int branches, const double *rows, int count, double *q, unsigned char *valid);

#endif
