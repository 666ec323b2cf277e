/* The yardstick of nasm/escape.py: the same kernel by hand, in C with intrinsics, for AVX-512 and
 * for AVX2. The best of some fifty variants on a Zen 4 (vectors in lockstep, interleaving, place and
 * form of the escape test); test_speed.py compiles it and times both in one run.
 *
 * A kick on the shifted angle X = x - 1/4, with row c[0..7] of coef:
 *   r = X - rint(X);  u = |r| - 1/4;  v = u*u;
 *   y = y + u*(c[0] + v*(c[1] + ... + v*c[7]));  X = r + y      (all FMAs, Horner)
 * Each lane keeps the largest |y - (lo+hi)/2| over 32 steps, tested once per 32.
 * Returns the number of orbits that were ever not inside (lo, hi) after a step (or at the start).
 * x (= X) and y hold the final state on return; n_orbits is a multiple of 64. */
#include <immintrin.h>

#ifdef __AVX512F__            /* vrange needs AVX512DQ */
enum { W = 8, G = 2, EARLY = 1 };
typedef __m512d V;
#define SET(a)      _mm512_set1_pd(a)
#define LOAD(p)     _mm512_loadu_pd(p)
#define STORE(p, a) _mm512_storeu_pd(p, a)
#define ADD(a, b)   _mm512_add_pd(a, b)
#define SUB(a, b)   _mm512_sub_pd(a, b)
#define MUL(a, b)   _mm512_mul_pd(a, b)
#define FMA(a,b,c)  _mm512_fmadd_pd(a, b, c)
#define RINT(a)     _mm512_roundscale_pd(a, 8)
/* vrange, mode 11: max(|a|,|b|) in one op, on the add pipes (unlike and, which
 * may be sent to the FMA pipes, the bottleneck) */
#define MAXABS(a,b) _mm512_range_pd(a, b, 11)
#define ABS(a)      MAXABS(a, a)
#define NOTLESS(a, b) (unsigned)_mm512_cmp_pd_mask(a, b, _CMP_NLT_UQ)
#else
enum { W = 4, G = 4, EARLY = 0 };
typedef __m256d V;
#define SET(a)      _mm256_set1_pd(a)
#define LOAD(p)     _mm256_loadu_pd(p)
#define STORE(p, a) _mm256_storeu_pd(p, a)
#define ADD(a, b)   _mm256_add_pd(a, b)
#define SUB(a, b)   _mm256_sub_pd(a, b)
#define MUL(a, b)   _mm256_mul_pd(a, b)
#define FMA(a,b,c)  _mm256_fmadd_pd(a, b, c)
#define RINT(a)     _mm256_round_pd(a, 8)
#define ABS(a)      _mm256_andnot_pd(_mm256_set1_pd(-0.0), a)
#define MAXABS(a,b) _mm256_max_pd(a, ABS(b))
#define NOTLESS(a, b) (unsigned)_mm256_movemask_pd(_mm256_cmp_pd(a, b, _CMP_NLT_UQ))
#endif

enum { LANES = 64, NV = LANES / W, CHECK = 32 };
#define UNROLL _Pragma("GCC unroll 16")
#define EACH(i, from, n) UNROLL for (int i = (from); i < (from) + (n); i++)

/* One kick of all NV vectors, G at a time; track: first update the reach with y. */
static inline __attribute__((always_inline))
void kick(const double *c, V *X, V *Y, V *reach, V mid, int track)
{
    UNROLL for (int g = 0; g < NV; g += G) {
        V u[NV], v[NV], p[NV];
        EACH(i, g, G) X[i] = SUB(X[i], RINT(X[i]));
        EACH(i, g, G) u[i] = SUB(ABS(X[i]), SET(0.25));
        EACH(i, g, G) v[i] = MUL(u[i], u[i]);
        if (track) EACH(i, g, G) reach[i] = MAXABS(reach[i], SUB(Y[i], mid));
        EACH(i, g, G) p[i] = FMA(SET(c[7]), v[i], SET(c[6]));
        UNROLL for (int k = 5; k >= 0; k--)
            EACH(i, g, G) p[i] = FMA(p[i], v[i], SET(c[k]));
        EACH(i, g, G) Y[i] = FMA(p[i], u[i], Y[i]);
        EACH(i, g, G) X[i] = ADD(X[i], Y[i]);
    }
}

double escape_blocks(const double *coef, long P, double *x, double *y,
                     long n_orbits, long n_steps, double lo, double hi)
{
    const V mid = SET(0.5 * (lo + hi)), half = SET(0.5 * (hi - lo));
    long escaped = 0;
    for (long b = 0; b < n_orbits; b += LANES) {
        V X[NV], Y[NV], reach[NV];
        unsigned out[NV] = {0};
        EACH(i, 0, NV) { X[i] = LOAD(x + b + i * W); Y[i] = LOAD(y + b + i * W); }
        for (long t = 0; t < n_steps; t += CHECK) {
            long m = n_steps - t < CHECK ? n_steps - t : CHECK;
            EACH(i, 0, NV) reach[i] = SET(0.0);
            for (long s = 0; s < m; s++) {
                /* EARLY: y of the step before is taken in between the work of the
                 * first kick, where the add pipes have room (3 % on Zen 4) */
                const double *c = coef;
                long k = P;
                if (EARLY) { kick(c, X, Y, reach, mid, 1); c += 8; k--; }
                for (; k > 0; k--, c += 8) kick(c, X, Y, reach, mid, 0);
                if (!EARLY) EACH(i, 0, NV) reach[i] = MAXABS(reach[i], SUB(Y[i], mid));
            }
            EACH(i, 0, NV) out[i] |= NOTLESS(reach[i], half)
                                   | NOTLESS(ABS(SUB(Y[i], mid)), half);
        }
        EACH(i, 0, NV) {
            STORE(x + b + i * W, X[i]); STORE(y + b + i * W, Y[i]);
            escaped += __builtin_popcount(out[i]);
        }
    }
    return (double)escaped;
}
