/* Waves and current at the riser: linear (Airy) waves in finite depth with a JONSWAP spectrum (Hasselmann et
 * al. 1973; DNV-RP-C205, 3.5). The motion of the water is computed in blocks of time steps. */
#include <math.h>
#include <string.h>

#include "liegrad/core.h"
#include "anomaly/riser.h"

#define PI        3.14159265358979323846
#define GAMMA     3.3
#define SPREADING 12 /* exponent of the cosine */
#define LOWEST    0.4
/* LOWEST and HIGHEST bound frequency/peak frequency. 0.1 % of the energy is above HIGHEST. */
#define HIGHEST     5.0
#define GRID        4096
#define NEWTON      50
#define STREAM_SEA  1
#define CURRENT_LAW (1.0 / 7.0)

/* ---- components ---- */

double lg_dispersion(double frequency, double depth, double gravity) {
    const double deep = frequency * frequency / gravity, x = deep * depth;
    if (x < 1e-30) return frequency / sqrt(gravity) / sqrt(depth); /* shallow water: tanh(k h) = k h */
    double kh = x / sqrt(tanh(x)); /* first guess by Eckart 1952, within 5 % */
    for (int i = 0; i < NEWTON; i++) {
        const double t = tanh(kh), change = (kh * t - x) / (t + kh * (1.0 - t * t));
        kh -= change;
        if (fabs(change) <= 1e-15 * kh) break;
    }
    return kh / depth;
}

/* JONSWAP spectrum, not normalised; x = frequency/peak frequency. */
static double spectrum(double x) {
    const double width = x <= 1.0 ? 0.07 : 0.09, r = (x - 1.0) / width;
    const double peak = pow(GAMMA, exp(-0.5 * r * r));
    return pow(x, -5.0) * exp(-1.25 * pow(x, -4.0)) * peak;
}

/* Draws x = frequency/peak frequency of each wave. Below x[j] lies the share (j + r_j)/n of the energy, with
 * a uniform random number r_j in [0, 1). */
static void draw_frequencies(lg_rng *rng, double x[LG_RISER_COMPONENTS]) {
    const double h = (HIGHEST - LOWEST) / GRID;
    double cdf[GRID + 1] = {0.0}, before = spectrum(LOWEST);
    for (size_t i = 1; i <= GRID; i++) {
        const double s = spectrum(LOWEST + (double)i * h);
        cdf[i] = cdf[i - 1] + 0.5 * (before + s);
        before = s;
    }
    size_t i = 0;
    for (size_t j = 0; j < LG_RISER_COMPONENTS; j++) {
        const double share = ((double)j + lg_rng_uniform(rng)) / LG_RISER_COMPONENTS * cdf[GRID];
        while (i + 1 < GRID && cdf[i + 1] <= share) i++;
        x[j] = LOWEST + h * ((double)i + (share - cdf[i]) / (cdf[i + 1] - cdf[i]));
    }
}

/* Draws an angle with density proportional to cos^12 on (-pi/2, pi/2), by rejection. */
static double draw_direction(lg_rng *rng) {
    for (;;) {
        const double angle = PI * (lg_rng_uniform(rng) - 0.5);
        if (lg_rng_uniform(rng) < pow(cos(angle), SPREADING)) return angle;
    }
}

static bool is_positive(double x) {
    return x > 0.0 && isfinite(x);
}

/* Whether frequency and wavenumber of all waves are positive and finite. For extreme periods they overflow or
 * underflow. */
static bool waves_fit(const lg_wave *waves) {
    for (size_t j = 0; j < LG_RISER_COMPONENTS; j++)
        if (!is_positive(waves[j].frequency) || !is_positive(waves[j].wavenumber)) return false;
    return true;
}

lg_status lg_sea_components(const lg_sea_state *sea, double depth, double gravity, uint64_t seed,
                            lg_wave waves[LG_RISER_COMPONENTS]) {
    if (!sea || !waves || !is_positive(depth) || !is_positive(gravity)) return LG_INVALID_ARGUMENT;
    if (!(sea->height >= 0.0) || !isfinite(sea->height) || !isfinite(sea->direction))
        return LG_INVALID_ARGUMENT;
    const bool calm = sea->height == 0.0;
    if (!calm && !is_positive(sea->period)) return LG_INVALID_ARGUMENT;
    const double peak = 2.0 * PI / (calm ? 1.0 : sea->period);
    double x[LG_RISER_COMPONENTS];
    lg_wave made[LG_RISER_COMPONENTS];
    lg_rng rng;
    lg_rng_seed(&rng, seed, STREAM_SEA);
    draw_frequencies(&rng, x);
    for (size_t j = 0; j < LG_RISER_COMPONENTS; j++) {
        const double frequency = peak * x[j];
        const double turn = draw_direction(&rng);
        made[j] = (lg_wave){.amplitude = sea->height / sqrt(8.0 * LG_RISER_COMPONENTS),
                            .frequency = frequency,
                            .wavenumber = lg_dispersion(frequency, depth, gravity),
                            .direction = sea->direction + turn,
                            .phase = 2.0 * PI * lg_rng_uniform(&rng)};
    }
    if (!waves_fit(made)) return LG_INVALID_ARGUMENT;
    memcpy(waves, made, sizeof made);
    return LG_OK;
}

/* ---- motion of the water ---- */

/* cosh(k z)/sinh(k h), rewritten so that it does not overflow. */
static double decay(double k, double z, double h) {
    return exp(k * (z - h)) * (1.0 + exp(-2.0 * k * z)) / -expm1(-2.0 * k * h);
}

/* Inertia force on a station per acceleration of the undisturbed water, N/(m/s^2). */
static double inertia_of(const lg_riser_parameters *p, size_t station) {
    const double area = PI / 4.0 * p->hydro_diameter * p->hydro_diameter;
    const double segment = p->rho * area * (1.0 + p->added_mass) * lg_riser_segment(p);
    return station == 0 ? p->rho * p->bop_volume + p->bop_added_mass : station == 1 ? segment / 2.0 : segment;
}

/* Amplitudes for one wave. The water velocity at a station is velocity[...] cos(frequency t + phase). The
 * generalised inertia force on a degree of freedom is inertia[...] sin(frequency t + phase). */
static void wave_rows(const lg_riser_parameters *p, const lg_wave *wave, double *velocity, double *inertia) {
    const double course[2] = {cos(wave->direction), sin(wave->direction)};
    for (size_t d = 0; d < 2; d++) {
        double *u = velocity + d * LG_RISER_ROW, *f = inertia + d * LG_RISER_ROW;
        for (size_t s = 0; s < LG_RISER_DOF; s++) {
            u[s] = wave->amplitude * wave->frequency * course[d] *
                   decay(wave->wavenumber, lg_riser_height(p, s), p->depth);
            f[s] = -wave->frequency * inertia_of(p, s) * u[s];
        }
        const double bop = f[0], joint = f[1];
        f[0] = bop + joint;
        f[1] = p->bop_centre * bop + p->bop_height * joint;
    }
}

static lg_status water_arrays(const lg_context *context, lg_water *w) {
    enum { N = LG_RISER_COMPONENTS, S = LG_RISER_STATE, H = LG_WATER_HALF + 1 };
    return LG_ALLOC_ALL(context, LG_ARRAY(w->velocity, N * S), LG_ARRAY(w->inertia, N * S),
                        LG_ARRAY(w->cosines, H * N), LG_ARRAY(w->sines, H * N),
                        LG_ARRAY(w->even_in, N * 2 * S), LG_ARRAY(w->odd_in, N * 2 * S),
                        LG_ARRAY(w->even, H * 2 * S), LG_ARRAY(w->odd, H * 2 * S),
                        LG_ARRAY(w->rows, LG_WATER_BLOCK * 2 * S), LG_ARRAY(w->frequency, N),
                        LG_ARRAY(w->phase, N), LG_ARRAY(w->now, N), LG_ARRAY(w->c, N), LG_ARRAY(w->s, N));
}

static bool rows_fit(const lg_water *w) {
    bool fit = true;
    for (size_t i = 0; i < (size_t)LG_RISER_COMPONENTS * LG_RISER_STATE; i++)
        fit = fit && isfinite(w->velocity[i]) && isfinite(w->inertia[i]);
    return fit;
}

static void water_fill(lg_water *w, const lg_riser_parameters *p, const lg_wave *waves) {
    enum { N = LG_RISER_COMPONENTS };
    for (size_t j = 0; j < N; j++) {
        w->frequency[j] = waves[j].frequency;
        w->phase[j] = waves[j].phase;
        wave_rows(p, &waves[j], w->velocity + j * LG_RISER_STATE, w->inertia + j * LG_RISER_STATE);
    }
    for (size_t i = 0; i <= LG_WATER_HALF; i++) {
        for (size_t j = 0; j < N; j++) w->now[j] = w->frequency[j] * ((double)i * w->dt);
        w->kernels->unary[LG_K_COS](N, 0.0, w->now, w->cosines + i * N);
        w->kernels->unary[LG_K_SIN](N, 0.0, w->now, w->sines + i * N);
    }
}

lg_status lg_water_create(const lg_context *context, const lg_riser_parameters *p, const lg_riser_run *run,
                          lg_water *out) {
    lg_wave waves[LG_RISER_COMPONENTS];
    lg_water w = {.kernels = lg_kernels_for(LG_F64),
                  .calm = run->sea.height == 0.0,
                  .dt = run->dt,
                  .ramp = run->ramp,
                  .block = SIZE_MAX};
    LG_TRY(lg_sea_components(&run->sea, p->depth, p->gravity, run->seed, waves));
    lg_status status = water_arrays(context, &w);
    if (status == LG_OK) {
        water_fill(&w, p, waves);
        if (!rows_fit(&w)) status = LG_INVALID_ARGUMENT;
    }
    if (status != LG_OK) {
        lg_water_destroy(context, &w);
        return status;
    }
    for (size_t s = 0; s < LG_RISER_DOF; s++)
        w.current[s] = p->current * pow(lg_riser_height(p, s) / p->depth, CURRENT_LAW);
    *out = w;
    return LG_OK;
}

void lg_water_destroy(const lg_context *context, lg_water *water) {
    LG_FREE_ALL(context, water->velocity, water->inertia, water->cosines, water->sines, water->even_in,
                water->odd_in, water->even, water->odd, water->rows, water->frequency, water->phase,
                water->now, water->c, water->s);
}

/* Factor on all forcing. It grows as half a cosine from 0 at t = 0 to 1 at t = ramp. */
static double ramp_at(const lg_water *w, double t) {
    return t >= w->ramp ? 1.0 : 0.5 - 0.5 * cos(PI * t / w->ramp);
}

/* Computes w->even and w->odd, the parts of velocity and inertia force that are even and odd in the time from
 * the middle of the block. */
static void waves_of_block(lg_water *w, double middle) {
    enum { N = LG_RISER_COMPONENTS, S = LG_RISER_STATE, H = LG_WATER_HALF + 1 };
    for (size_t j = 0; j < N; j++) {
        const double angle = w->frequency[j] * middle + w->phase[j];
        w->now[j] = angle - 2.0 * PI * floor(angle / (2.0 * PI));
    }
    w->kernels->unary[LG_K_COS](N, 0.0, w->now, w->c);
    w->kernels->unary[LG_K_SIN](N, 0.0, w->now, w->s);
    for (size_t j = 0; j < N; j++) {
        const double c = w->c[j], s = w->s[j], *u = w->velocity + j * S, *f = w->inertia + j * S;
        double *even = w->even_in + j * 2 * S, *odd = w->odd_in + j * 2 * S;
        for (size_t i = 0; i < S; i++) {
            even[i] = c * u[i];
            even[S + i] = s * f[i];
            odd[i] = -s * u[i];
            odd[S + i] = c * f[i];
        }
    }
    w->kernels->gemm(H, 2 * S, N, w->cosines, N, 1, w->even_in, 2 * S, w->even, 2 * S, false);
    w->kernels->gemm(H, 2 * S, N, w->sines, N, 1, w->odd_in, 2 * S, w->odd, 2 * S, false);
}

/* Computes the rows of the block, at LG_WATER_HALF + i and LG_WATER_HALF - i, from the even and odd parts.
 * Adds the current and applies the ramp. */
static void rows_of_block(lg_water *w, double first) {
    enum { W = 2 * LG_RISER_STATE };
    for (size_t r = 0; r < LG_WATER_BLOCK; r++) {
        const bool after = r >= LG_WATER_HALF;
        const size_t i = after ? r - LG_WATER_HALF : LG_WATER_HALF - r;
        const double *even = w->even + i * W, *odd = w->odd + i * W, sign = after ? 1.0 : -1.0;
        const double ramp = ramp_at(w, first + (double)r * w->dt);
        double *row = w->rows + r * W;
        for (size_t k = 0; k < W; k++) row[k] = ramp * (even[k] + sign * odd[k]);
        for (size_t k = 0; k < LG_RISER_STATE; k++) row[k] += ramp * w->current[k];
    }
}

const double *lg_water_at(lg_water *w, size_t n) {
    const size_t block = n / LG_WATER_BLOCK, first = block * LG_WATER_BLOCK;
    if (block != w->block) {
        if (!w->calm) waves_of_block(w, (double)(first + LG_WATER_HALF) * w->dt);
        rows_of_block(w, (double)first * w->dt);
        w->block = block;
    }
    return w->rows + (n - first) * 2 * LG_RISER_STATE;
}
