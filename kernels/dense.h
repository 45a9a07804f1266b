/* Small dense matrices, row-major. */
#ifndef POISE_DENSE_H
#define POISE_DENSE_H

#include "poise_kernels.h"

/* Factor a in place with row exchanges; POISE_SINGULAR for a pivot of zero. NaN passes through, as in LAPACK. */
int factor_rows(double *a, int n, int *exchanges);
/* Log of the absolute value of the determinant of factored rows. */
double log_determinant(const double *a, int n);
/* right (n, columns) becomes the solution. */
void solve_rows(const double *a, int n, const int *exchanges, double *right, int columns);
/* out (n, n) = the inverse of a, of at most 16 rows; POISE_SINGULAR as above. */
int inverse(const double *a, int n, double *out);

/* a becomes its lower factor (what is above the diagonal stays); POISE_NOT_POSITIVE when there is none. */
int cholesky(double *a, int64_t n);
/* values (n,) and vectors (n, n), in columns, of a symmetric matrix, which is lost (cyclic Jacobi). */
void eigen(double *a, int64_t n, double *values, double *vectors);

/* out (rows, columns) = a (rows, inner) b (inner, columns) */
void product(const double *a, const double *b, int64_t rows, int64_t inner, int64_t columns, double *out);
/* out (rows) = a (rows, inner) v */
void apply(const double *a, const double *v, int64_t rows, int64_t inner, double *out);

#endif
