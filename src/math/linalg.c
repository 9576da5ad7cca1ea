#include "math/linalg.h"

#include <math.h>
#include <string.h>

double cn_norm3(const double a[3])
{
    return sqrt(cn_dot3(a, a));
}

double cn_distance3(const double a[3], const double b[3])
{
    const double d[3] = { a[0] - b[0], a[1] - b[1], a[2] - b[2] };
    return cn_norm3(d);
}

void cn_cross3(const double a[3], const double b[3], double out[3])
{
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

bool cn_normalize3(double a[3])
{
    const double length = cn_norm3(a);
    if (!(length > 0) || !isfinite(length)) return false;
    for (int i = 0; i < 3; i++)
        a[i] /= length;
    return true;
}

void cn_mat3_mul(const double a[9], const double b[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

void cn_mat3_vec(const double m[9], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = cn_dot3(m + 3 * i, v);
}

void cn_mat3_tvec(const double m[9], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = m[i] * v[0] + m[3 + i] * v[1] + m[6 + i] * v[2];
}

void cn_mat3_transpose(const double m[9], double out[9])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * j + i] = m[3 * i + j];
}

static double dot4(const double a[4], const double b[4])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}

static void quat_unit(const double q[4], double out[4])
{
    static const double identity[4] = { 1, 0, 0, 0 };
    const double length = sqrt(dot4(q, q));
    const bool usable = length > 0 && isfinite(length);
    for (int i = 0; i < 4; i++)
        out[i] = usable ? q[i] / length : identity[i];
}

void cn_quat_to_mat3(const double q[4], double m[9])
{
    double u[4];
    quat_unit(q, u);
    const double w = u[0], x = u[1], y = u[2], z = u[3];
    m[0] = 1 - 2 * (y * y + z * z);
    m[1] = 2 * (x * y - w * z);
    m[2] = 2 * (x * z + w * y);
    m[3] = 2 * (x * y + w * z);
    m[4] = 1 - 2 * (x * x + z * z);
    m[5] = 2 * (y * z - w * x);
    m[6] = 2 * (x * z - w * y);
    m[7] = 2 * (y * z + w * x);
    m[8] = 1 - 2 * (x * x + y * y);
}

void cn_turn_to_mat3(const double turn[3], double m[9])
{
    const double angle = cn_norm3(turn), half = 0.5 * angle, s = angle > 1e-12 ? sin(half) / angle : 0.5;
    const double quaternion[4] = { cos(half), s * turn[0], s * turn[1], s * turn[2] };
    cn_quat_to_mat3(quaternion, m);
}

/* Shepperd's method: divide by the largest of the four components, never by a small one. */
void cn_mat3_to_quat(const double m[9], double q[4])
{
    const double squares[4] = { 1 + m[0] + m[4] + m[8], 1 + m[0] - m[4] - m[8], 1 - m[0] + m[4] - m[8],
                                1 - m[0] - m[4] + m[8] };
    int largest = 0;
    for (int i = 1; i < 4; i++)
        if (squares[i] > squares[largest]) largest = i;
    const double products[4][4] = {
        { squares[0], m[7] - m[5], m[2] - m[6], m[3] - m[1] },
        { m[7] - m[5], squares[1], m[1] + m[3], m[2] + m[6] },
        { m[2] - m[6], m[1] + m[3], squares[2], m[5] + m[7] },
        { m[3] - m[1], m[2] + m[6], m[5] + m[7], squares[3] },
    };
    quat_unit(products[largest], q);
    if (q[0] < 0)
        for (int i = 0; i < 4; i++)
            q[i] = -q[i];
}

void cn_quat_slerp(const double a[4], const double b[4], double t, double out[4])
{
    double from[4], to[4], sum[4];
    quat_unit(a, from);
    quat_unit(b, to);
    double cosine = dot4(from, to);
    const double sign = cosine < 0 ? -1 : 1; /* q and -q are the same rotation: take the shorter way */
    cosine *= sign;
    double weight_from = 1 - t, weight_to = t;
    if (cosine < 1 - 1e-10) {
        const double angle = acos(cosine), scale = 1 / sin(angle);
        weight_from = sin((1 - t) * angle) * scale;
        weight_to = sin(t * angle) * scale;
    }
    for (int i = 0; i < 4; i++)
        sum[i] = weight_from * from[i] + sign * weight_to * to[i];
    quat_unit(sum, out);
}

/* A Jacobi rotation of rows and columns p and q of the n x n matrix a that makes a[p][q] zero; v accumulates the
 * rotations. */
static void jacobi_rotate(int n, double a[16], double *v, int p, int q)
{
    const double theta = (a[q * n + q] - a[p * n + p]) / (2 * a[p * n + q]);
    const double t = copysign(1, theta) / (fabs(theta) + hypot(theta, 1));
    const double c = 1 / hypot(t, 1), s = t * c;
    for (int k = 0; k < n; k++) {
        const double x = a[k * n + p], y = a[k * n + q];
        a[k * n + p] = c * x - s * y;
        a[k * n + q] = s * x + c * y;
    }
    for (int k = 0; k < n; k++) {
        const double x = a[p * n + k], y = a[q * n + k];
        a[p * n + k] = c * x - s * y;
        a[q * n + k] = s * x + c * y;
    }
    for (int k = 0; k < n; k++) {
        const double x = v[k * n + p], y = v[k * n + q];
        v[k * n + p] = c * x - s * y;
        v[k * n + q] = s * x + c * y;
    }
    a[p * n + q] = a[q * n + p] = 0;
}

static void sort_eigen(int n, double *values, double *v)
{
    for (int i = 0; i < n; i++) {
        int least = i;
        for (int j = i + 1; j < n; j++)
            if (values[j] < values[least]) least = j;
        if (least == i) continue;
        const double value = values[i];
        values[i] = values[least];
        values[least] = value;
        for (int k = 0; k < n; k++) {
            const double item = v[k * n + i];
            v[k * n + i] = v[k * n + least];
            v[k * n + least] = item;
        }
    }
}

void cn_eigen_symmetric(int n, const double *a, double *values, double *v)
{
    enum { MAX_SWEEPS = 40 }; /* convergence is quadratic: six are usual */
    double work[16];
    memcpy(work, a, (size_t)(n * n) * sizeof *a);
    for (int i = 0; i < n * n; i++)
        v[i] = i % (n + 1) == 0;
    for (int sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        bool turned = false;
        for (int p = 0; p < n; p++)
            for (int q = p + 1; q < n; q++) {
                const double off = fabs(work[p * n + q]);
                if (!(off > 1e-17 * (fabs(work[p * n + p]) + fabs(work[q * n + q]))) || off < 1e-300) continue;
                jacobi_rotate(n, work, v, p, q);
                turned = true;
            }
        if (!turned) break;
    }
    for (int i = 0; i < n; i++)
        values[i] = work[i * n + i];
    sort_eigen(n, values, v);
}

/* Hoare's selection. Indices are signed, because the right one may become -1. */
double cn_select(double *values, size_t n, size_t k)
{
    ptrdiff_t left = 0, right = (ptrdiff_t)n - 1;
    const ptrdiff_t wanted = (ptrdiff_t)k;
    while (left < right) {
        const double pivot = values[wanted];
        ptrdiff_t i = left, j = right;
        do {
            while (values[i] < pivot)
                i++;
            while (pivot < values[j])
                j--;
            if (i <= j) {
                const double value = values[i];
                values[i++] = values[j];
                values[j--] = value;
            }
        } while (i <= j);
        if (j < wanted) left = i;
        if (wanted < i) right = j;
    }
    return values[k];
}

bool cn_solve4(double a[4][4], double b[4][3])
{
    for (int k = 0; k < 4; k++) {
        int pivot = k;
        for (int i = k + 1; i < 4; i++)
            if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
        if (!(fabs(a[pivot][k]) > 1e-9)) return false;
        for (int c = 0; c < 4; c++) {
            const double t = a[k][c];
            a[k][c] = a[pivot][c], a[pivot][c] = t;
        }
        for (int c = 0; c < 3; c++) {
            const double t = b[k][c];
            b[k][c] = b[pivot][c], b[pivot][c] = t;
        }
        for (int i = 0; i < 4; i++) {
            if (i == k) continue;
            const double f = a[i][k] / a[k][k];
            for (int c = 0; c < 4; c++)
                a[i][c] -= f * a[k][c];
            for (int c = 0; c < 3; c++)
                b[i][c] -= f * b[k][c];
        }
    }
    for (int k = 0; k < 4; k++)
        for (int c = 0; c < 3; c++)
            b[k][c] /= a[k][k];
    return true;
}
