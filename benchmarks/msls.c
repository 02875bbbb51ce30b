/* MSLS in plain C: the limit that the benchmark quotes. Built with `cc -O3`, nothing vectorised by hand.
 *
 * The literal eq 14 of Ward et al., its penalty rows W0 kept in the factor: one Householder reflection per column over
 * the factor's pivot row, the regressor and penalty rows 0..j,
 *
 *     [ sqrt(lambda) R | 0 ]
 *     [     phi        | 1 ]  --->  [ R' | z ],     R' K = z,     theta_q += K (y_q - phi' theta_q)
 *     [     W0         | 0 ]
 *
 * and nothing else: no error bars, no check of the input. All matrices are stored by columns, which is faster here
 * than by rows by half: L[k] is column k of R, L[p] is z; B[k] holds column k of the rows below R, phi first.
 */

#include <math.h>

static void gain(int p, double *restrict L, const double *restrict phi, const double *restrict w0, double lambda,
                 double *restrict K, double *restrict B)
{
    const int n = p + 1;
    const double root = sqrt(lambda);

    for (int k = 0; k < p; k++) {
        B[k * n] = phi[k];
        for (int i = 0; i <= k; i++)
            L[k * p + i] *= root;
        L[p * p + k] = 0.0;
    }
    B[p * n] = 1.0;
    for (int j = 0; j < p; j++) {
        double *v = B + j * n;
        v[j + 1] = w0[j];
        double below = 0.0;
        for (int i = 0; i < j + 2; i++)
            below += v[i] * v[i];
        if (below == 0.0) {
            for (int k = j + 1; k < n; k++)
                B[k * n + j + 1] = 0.0;
            continue;
        }
        const double x = L[j * p + j];
        const double norm = sqrt(x * x + below);
        const double alpha = x >= 0.0 ? -norm : norm;
        const double v0 = x - alpha;
        const double h = -1.0 / (alpha * v0);
        for (int k = j + 1; k < n; k++) {
            double *restrict b = B + k * n;
            double f = v0 * L[k * p + j];
            for (int i = 0; i < j + 1; i++)
                f += v[i] * b[i];
            f *= h;
            L[k * p + j] -= v0 * f;
            for (int i = 0; i < j + 1; i++)
                b[i] -= v[i] * f;
            b[j + 1] = -v[j + 1] * f;
        }
        L[j * p + j] = alpha;
    }
    double *z = L + p * p;
    for (int j = p - 1; j >= 0; j--) {
        K[j] = L[j * p + j] != 0.0 ? z[j] / L[j * p + j] : 0.0;
        for (int i = 0; i < j; i++)
            z[i] -= L[j * p + i] * K[j];
    }
}

/* Take `samples` samples, phi (samples, p) and y (samples, rows). State: L (p + 1, p) and theta (rows, p), zero at the
 * start. K (p) is the last gain, work (p + 1, p + 1) scratch. */
void msls_run(int samples, int p, int rows, double *restrict L, double *restrict theta, const double *restrict phi,
              const double *restrict y, const double *restrict w0, double lambda, double *restrict K,
              double *restrict work)
{
    for (int n = 0; n < samples; n++) {
        const double *restrict x = phi + n * p;
        gain(p, L, x, w0, lambda, K, work);
        for (int q = 0; q < rows; q++) {
            double *restrict t = theta + q * p;
            double e = y[n * rows + q];
            for (int i = 0; i < p; i++)
                e -= t[i] * x[i];
            for (int i = 0; i < p; i++)
                t[i] += K[i] * e;
        }
    }
}
