#ifndef KR_EIGENVALUES_H
#define KR_EIGENVALUES_H

/* Eigenvalues of a real matrix a (n, n), which is destroyed: real and imaginary parts, of a conjugate pair the positive
 * one first. Returns 0 if the matrix is not finite, or the algorithm does not converge. */
int kr_eigenvalues(int n, double *a, double *real, double *imaginary);

#endif
