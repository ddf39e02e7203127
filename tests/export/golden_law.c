/* A law. */
#include "law_in_c.h"

#include <float.h>
#include <math.h>
#include <stdint.h>

#ifdef __FAST_MATH__
#error "-ffast-math changes the law: leave it out"
#endif
#if FLT_EVAL_METHOD != 0
#error "numbers must be rounded after every operation: for x86 of 32 bits take -mfpmath=sse"
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif

const struct law_in_c_numbers law_in_c_numbers = {
    .K = {-0.9999999999999988, -1.069944426870997},
    .G = {0.0, -0.08650674662668663},
    .S = {0.9999999999999986, 1.0831378301693477},
    .GB_inverse = {1.0000000000000002},
    .GB_held = {0.9999999999999998},
    .size_of_GB = 0.9999999999999998,
    .switching = {
        .gain = 1.0,
    },
    .eta = 0.6000000000000001,
    .gamma0 = 1.4992503748125934,
    .gamma1 = 2.948347034623951,
    .k = 0.0,
    .epsilon = 0.0,
    .limit = INFINITY,
};

static const struct law_in_c_numbers *const p = &law_in_c_numbers;

static inline double min_(double a, double b) { return b < a ? b : a; }
static inline double max_(double a, double b) { return b > a ? b : a; }

/* [from the equations] */
static void transformation(const double *x, double out[2])
{
    out[0] = x[0];
    out[1] = x[1];
}

/* [symbolic.py:89] */
static void error_state(const double *x, double *z)
{
    double transformation1_[2];
    transformation(x, transformation1_);
    z[0] = -1.0 * (transformation1_[0] - 1.0);
    z[1] = -1.0 * (transformation1_[1] - 0.0);
}

/* Bring the integral of memory.rate up to the sample at t [s]. [surface.py:48] */
static void integrate(double t, struct law_in_c_memory *memory)
{
    memory->elapsed = t - memory->t;
    memory->t = t;
    memory->integral[0] += memory->rate[0] * memory->elapsed;
}

/* Entry i of K z. [matrices.py:35] */
static double row_times(const double *K, const double *z)
{
    double total = 0.0;
    for (int j = 0; j < 2; j++) {
        total += K[j] * z[j];
    }
    return total;
}

/* s = G [z - z(0)] - integral of S z, eqs. (8), (31) and (51), into memory.s. [surface.py:19] */
static void integral_surface(double t, const double *z, struct law_in_c_memory *memory)
{
    if (!memory->begun) {
        memory->t = t;
        for (int j = 0; j < 2; j++) {
            memory->z0[j] = z[j];
        }
    }
    integrate(t, memory);
    memory->rate[0] = row_times(p->S, z);
    double total = 0.0;
    for (int j = 0; j < 2; j++) {
        total += p->G[j] * (z[j] - memory->z0[j]);
    }
    memory->s[0] = total - memory->integral[0];
}

/* Entry i of K z. [matrices.py:35] */
static double row_times_2(const double *K, const double *z)
{
    double total = 0.0;
    total += K[0] * z[0];
    return total;
}

/* The Euclidean norm of a vector. [matrices.py:19] */
static double norm(const double *z)
{
    double total = 0.0;
    for (int k1_ = 0; k1_ < 2; k1_++) {
        total += z[k1_] * z[k1_];
    }
    return sqrt(total);
}

/* |G B|, for a law whose switching gain does not follow E(x). [laws.py:105] */
static double size_of_GB(void)
{
    return p->size_of_GB;
}

/* The sign function as printed: -1, 0 or 1. [switching.py:193] */
static double sgn(double s)
{
    if (s > 0.0) {
        return 1.0;
    }
    return s < 0.0 ? -1.0 : 0.0;
}

/* phi of the implicit Euler step s+ = s + h (-k s+ - rho sgn(s+)), in closed form.
   [switching.py:201] */
static double implicit(double s, double k, double rho, double h)
{
    if (h == 0.0) {
        return 0.0;
    }
    const double size = max_(fabs(s) - h * rho, 0.0);
    const double next_s = sgn(s) * size / (1.0 + h * k);
    return (next_s - s) / h;
}

/* Sign law by implicit Euler (Acary, Brogliato): phi moves only as the disturbance does.
   [switching.py:248] */
static void implicit_2(const double *s, double k, double rho, double *phi, struct law_in_c_memory
        *memory)
{
    phi[0] = implicit(s[0], k, p->switching.gain * rho, memory->elapsed);
}

/* u = v, or v = u: input maps of a law of a linear model. [base.py:226] */
static void copy(const double *values, double *result)
{
    result[0] = values[0];
}

/* [laws.py:73] */
static void law(double t, const double *x, double *u, struct law_in_c_memory *memory)
{
    error_state(x, memory->z);
    integral_surface(t, memory->z, memory);
    memory->v[0] = 0.0 - row_times(p->K, memory->z);
    const double nominal = min_(p->limit, max_(-p->limit, memory->v[0]));
    u[0] = nominal - memory->v[0];
    memory->v[0] = nominal;
    memory->rate[0] += row_times_2(p->GB_held, u);
    const double bound = p->gamma0 + p->gamma1 * norm(memory->z);
    const double rho = p->eta + p->epsilon + bound * size_of_GB();
    implicit_2(memory->s, p->k, rho, memory->phi, memory);
    memory->v[0] += row_times_2(p->GB_inverse, memory->phi);
    copy(memory->v, u);
}

void law_in_c_init(struct law_in_c_memory *memory)
{
    *memory = (struct law_in_c_memory){
        .v = {0.0},
        .undefined = 0.0,
        .begun = 0.0,
        .z = {0.0, 0.0},
        .s = {0.0},
        .phi = {0.0},
        .z0 = {0.0, 0.0},
        .integral = {0.0},
        .rate = {0.0},
        .t = 0.0,
        .elapsed = 0.0,
    };
}

int law_in_c_step(double t, const double x[2],
        struct law_in_c_memory *memory, double u[1])
{
    law(t, x, u, memory);
    memory->begun = 1;
    if (memory->undefined != 0) {
        return 1;
    }
    if (!isfinite(u[0])) {
        return 2;
    }
    return 0;
}
