/* Small double-precision linear algebra. Matrices are row-major. No state: any thread. */
#ifndef CONURB_MATH_LINALG_H
#define CONURB_MATH_LINALG_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

static inline double cn_dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
double cn_norm3(const double a[3]);
double cn_distance3(const double a[3], const double b[3]);
void cn_cross3(const double a[3], const double b[3], double out[3]);
bool cn_normalize3(double a[3]); /* false (unchanged) for zero or non-finite length */
void cn_mat3_mul(const double a[9], const double b[9], double out[9]);  /* out may not alias */
void cn_mat3_vec(const double m[9], const double v[3], double out[3]);  /* out may not alias */
void cn_mat3_tvec(const double m[9], const double v[3], double out[3]); /* transpose(m) v */
void cn_mat3_transpose(const double m[9], double out[9]);
/* Quaternion w x y z (Hamilton, COLMAP's order). It is normalised here; one of length 0 is the identity. */
void cn_quat_to_mat3(const double q[4], double m[9]);
/* Rotation by the length of `turn`, in radians, about its direction (Rodrigues). */
void cn_turn_to_mat3(const double turn[3], double m[9]);
void cn_mat3_to_quat(const double m[9], double q[4]); /* w >= 0 */
/* Spherical interpolation from a (t = 0) to b (t = 1) by the shorter way (Shoemake 1985, "Animating rotation with
 * quaternion curves"). */
void cn_quat_slerp(const double a[4], const double b[4], double t, double out[4]);
/* Eigenvalues (ascending) and unit eigenvectors (columns of v) of a symmetric n x n matrix, 1 <= n <= 4, by Jacobi
 * rotations. The signs of the vectors are arbitrary. */
void cn_eigen_symmetric(int n, const double *a, double *values, double *v);
/* Solves a x = b for a symmetric 4 x 4 matrix and three right-hand sides, by elimination with pivots. b becomes x; a is
 * lost. False when a is singular. */
bool cn_solve4(double a[4][4], double b[4][3]);
/* k-th smallest of n values (0-based, k < n); reorders values. The values must not be NaN. */
double cn_select(double *values, size_t n, size_t k);
#endif
