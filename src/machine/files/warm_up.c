/* Short fits of a machine before its fit, from which the first parameters come. If the logs measure positions
 * alone, there are several ways to first parameters, and short windows that are the same for all decide. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/median.h"
#include "machine/files/recipe.h"

bool lg_machine_is_small(const lg_machine *machine) {
    enum { FEW = 60 };
    return machine->parameters <= FEW;
}

/* A fit of short windows: evaluations per round; it takes at most 1/WINDOWS_SHARE of the time. */
enum { STAGE_EPOCHS = 50, WINDOWS_SHARE = 8 };

/* A short fit, of at most `epochs` evaluations of Levenberg-Marquardt in each of up to 4 rounds and 1/share
 * of the time. Numbers are held near their first values, in proportion to the loss that is left: a number
 * that ran to 0 or infinity would never come back. theta, in and out, has the problem's parameters. */
static lg_status run_fit(lg_training *self, const lg_machine *machine, const lg_fit_problem *problem,
                         uint64_t epochs, int share, double *theta, lg_error *error) {
    enum { EPOCHS = 200, ROUNDS = 4 };
    static const double pull = 0.02, slow = 0.9;
    const bool few = lg_machine_is_small(machine);
    const size_t numbers = problem->parameters < machine->parameters ? 0 : machine->parameters;
    lg_fit_problem held = *problem;
    lg_fit_options chosen = self->options;
    double *decay, loss = 0, before = INFINITY;
    LG_TRAINING_ARRAY(self, decay, problem->parameters, error);
    (void)lg_fit_plan_parse(few ? "lm" : problem->own > 0 ? "lbfgs" : "ssbroyden", true, &chosen.plan, NULL);
    chosen.seconds = self->options.seconds / share / ROUNDS;
    chosen.validation = chosen.prior = 0;
    chosen.keep_best = false;
    chosen.patience = chosen.stop_after = chosen.checkpoint_every = 0;
    chosen.checkpoint = NULL;
    chosen.on_epoch = NULL;
    for (int round = few ? 0 : ROUNDS; round <= ROUNDS && !(loss > slow * before); round++) {
        LG_CLEAN(lg_fit_destroy_at) lg_fit *fit = NULL;
        if (round > 1) before = loss;
        chosen.epochs = !few ? EPOCHS : round == 0 ? 1 : epochs;
        LG_TRY(lg_fit_create(self->context, &held, &chosen, theta, &fit, error));
        LG_TRY(lg_fit_run(fit, error));
        lg_fit_parameters(fit, theta);
        loss = lg_fit_loss(fit);
        for (size_t i = machine->weights; i < numbers; i++) decay[i] = pull * loss;
        held.decay = decay;
    }
    return LG_OK;
}

/* A short fit of `problem`. Takes its parameters if they lower the loss by more than rounding error: along
 * directions that the logs leave open, a fit would follow rounding error arbitrarily far. */
static lg_status fit_stage(lg_training *self, const lg_machine_problem *problem, uint64_t epochs, int share,
                           double *theta, lg_error *error) {
    static const double rounding = 1e-9;
    const size_t n = lg_machine_problem_parameters(problem);
    lg_fit_problem fit_problem;
    double before = 0, after = 0, *found;
    LG_TRAINING_ARRAY(self, found, n, error);
    memcpy(found, theta, n * sizeof *found);
    lg_machine_fit_problem(problem, &fit_problem);
    LG_TRY(run_fit(self, problem->machine, &fit_problem, epochs, share, found, error));
    LG_TRY(lg_machine_loss(self->context, problem, theta, &before, NULL, error));
    LG_TRY(lg_machine_loss(self->context, problem, found, &after, NULL, error));
    if (after < (1.0 - rounding) * before || !isfinite(before)) memcpy(theta, found, n * sizeof *found);
    return LG_OK;
}

/* Copies the parameters of the system, which are those of its mass term. */
static void copy_system(const lg_machine *machine, const double *from, double *to) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        if (strcmp(lg_term_kind_name(term->kind), "system") == 0)
            memcpy(to + term->offset, from + term->offset, term->parameters * sizeof *to);
}

/* The initial parameters of a system may make it too stiff for the integrator's steps. A step of explicit
 * Euler is linear in the acceleration and works from any start. Euler's own error would appear as damping, so
 * that only the system's parameters are kept, and only if they do not raise the loss. */
static lg_status approach(lg_training *self, const lg_machine_problem *on, double *theta, lg_error *error) {
    double before = 0, after = 0, *own, *start;
    const lg_machine *machine = on->machine;
    if (machine->grey.system == NULL) return LG_OK;
    const size_t n = machine->parameters;
    lg_machine_problem problem = *on;
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    LG_TRAINING_ARRAY(self, own, n + 1, error);
    LG_TRAINING_ARRAY(self, start, n + 1, error);
    memcpy(own, theta, n * sizeof *own);
    memcpy(start, theta, n * sizeof *start);
    LG_TRY(lg_machine_loss(self->context, &problem, theta, &before, NULL, error));
    problem.scheme = lg_scheme_find("lie-euler");
    LG_TRY(fit_stage(self, &problem, STAGE_EPOCHS, WINDOWS_SHARE, own, error));
    problem.scheme = on->scheme;
    copy_system(machine, own, start);
    LG_TRY(lg_machine_loss(self->context, &problem, start, &after, NULL, error));
    if (isfinite(after) && !(after > before)) memcpy(theta, start, n * sizeof *start);
    return LG_OK;
}

/* ---- first parameters from positions alone ---- */

enum {
    PART = 3,      /* windows that compare the candidates are this part of the fit's */
    ENOUGH = 1000, /* intervals for a regression of momenta */
    FINALISTS = 4,
    FEW = 15,  /* evaluations in a round of a candidate's fit */
    SHARE = 40 /* a candidate's fit takes at most this part of the time */
};

typedef enum way {
    AS_GIVEN,   /* the parameters as they are */
    APPROACHED, /* steps of explicit Euler on short windows */
    MOMENTA     /* a regression of momenta */
} way;

/* `half`: half width, in rows, of the polynomials that give velocities. Noise needs wide ones, fast motion
 * narrow ones. */
typedef struct candidate {
    way way;
    uint32_t half;
} candidate;
static const candidate candidates[] = {{MOMENTA, 15},   {MOMENTA, 40},    {MOMENTA, 6},
                                       {APPROACHED, 2}, {APPROACHED, 15}, {AS_GIVEN, 0}};

/* What a candidate's fit of the windows that compare them left. */
typedef struct tried {
    double loss;   /* first: it sorts them */
    double *theta; /* (parameters) */
} tried;

typedef struct stages {
    lg_training *self;
    lg_machine_problem compared; /* with estimated starts */
    uint32_t shortest;           /* window that compares all candidates */
    size_t parameters, count;    /* parameters of `compared`; candidates in `all` */
    tried all[LG_COUNT(candidates)];
} stages;

/* ---- a log with velocities ---- */

double lg_log_speed(const lg_machine *machine, const lg_machine_log *log, uint32_t coordinate) {
    const lg_machine_offsets at = lg_machine_offsets_of(machine, coordinate);
    lg_squares squares = {0, 0};
    for (size_t row = 0; row < log->rows; row++)
        for (uint32_t k = at.velocity; k < at.velocity + at.velocities; k++)
            lg_squares_add(&squares, lg_log_shown(log)[row * machine->velocities + k]);
    return fmax(lg_squares_root(&squares), 0.0);
}

/* Scales of the loss: the root mean square of a coordinate's velocities, and half the way that this covers in
 * a window. */
static void set_scales(const lg_machine_log *log, double seconds, lg_machine_problem *problem) {
    for (uint32_t i = 0; i < problem->machine->coordinate_count; i++) {
        const double speed = lg_log_speed(problem->machine, log, i);
        if (!(speed > 0)) continue;
        problem->velocity_scale[i] = speed;
        problem->position_scale[i] = 0.5 * seconds * speed;
    }
}

/* Fits windows of `half` rows of a log whose velocities come from polynomials through 2 half + 1 rows. */
static lg_status fit_smoothed(stages *s, const candidate *from, double *theta, lg_error *error) {
    const uint32_t half = from->half;
    lg_training *self = s->self;
    const lg_machine_state *state = self->state;
    const lg_machine_model_run *run = self->run;
    const lg_machine *machine = s->compared.machine;
    lg_machine_problem problem = s->compared;
    const lg_machine_log *log = &problem.log;
    LG_CLEAN(lg_started_log_destroy) lg_started_log smooth = {.q = NULL};
    size_t *start;
    LG_TRAINING_ARRAY(self, start, state->data.training.rows, error);
    LG_TRY(lg_machine_smooth(self->context, machine, &state->data.training, half, 3, &smooth, error));
    problem.log = smooth.log;
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    problem.window = from->way == MOMENTA ? 2 : half + 1;
    const uint32_t stride = from->way == MOMENTA ? (uint32_t)(log->rows / ENOUGH + 1) : half;
    problem.windows = lg_machine_windows(machine, log, problem.window, stride, false, start);
    problem.start = start;
    problem.validation = 0;
    if (problem.windows == 0) return LG_OK;
    set_scales(log, half * run->dt, &problem);
    if (from->way == MOMENTA) {
        lg_fit_problem regression;
        lg_machine_momentum_problem(&problem, &regression);
        /* its result is always taken */
        LG_TRY(run_fit(self, machine, &regression, STAGE_EPOCHS, SHARE, theta, error));
        const uint32_t rows = half + 1;
        problem.window = rows;
        problem.windows = lg_machine_windows(machine, log, rows, half, false, start);
        if (problem.windows == 0) return LG_OK;
        return fit_stage(self, &problem, FEW, SHARE, theta, error);
    }
    return approach(self, &problem, theta, error);
}

/* The loss that the noise of the positions leaves. */
static double expected(const stages *s) {
    const lg_machine_state *state = s->self->state;
    const lg_machine_file *file = &state->data.file;
    double sum = 0;
    for (uint32_t i = 0; i < s->compared.machine->coordinate_count; i++) {
        const lg_log_coordinate *at = &file->coordinates[i];
        const uint32_t first[] = {at->place, at->attitude}, count[] = {at->places, at->attitudes};
        for (int k = 0; k < 2; k++)
            for (uint32_t j = first[k]; j < first[k] + count[k]; j++) {
                const double noise = state->data.logs.columns[j].noise / s->compared.position_scale[i];
                if (isfinite(noise)) sum += noise * noise;
            }
    }
    return sum;
}

/* ---- candidates ---- */

/* Fits the windows that compare candidates. A run that is not finite has an infinite loss. */
static lg_status compare(stages *s, uint64_t epochs, tried *one, lg_error *error) {
    lg_status status = fit_stage(s->self, &s->compared, epochs, SHARE, one->theta, error);
    if (status == LG_OK)
        status = lg_machine_loss(s->self->context, &s->compared, one->theta, &one->loss, NULL, error);
    if (status == LG_NOT_FINITE) status = lg_fail(error, LG_OK, "%s", "");
    if (isnan(one->loss)) one->loss = INFINITY;
    return status;
}

static lg_status try_candidate(stages *s, const double *theta, const candidate *from, lg_error *error) {
    tried *one = &s->all[s->count++];
    one->loss = INFINITY;
    LG_TRAINING_ARRAY(s->self, one->theta, s->parameters, error);
    memcpy(one->theta, theta, s->compared.machine->parameters * sizeof *theta);
    const lg_status status = from->way != AS_GIVEN ? fit_smoothed(s, from, one->theta, error) : LG_OK;
    if (status == LG_NOT_FINITE) return lg_fail(error, LG_OK, "%s", "");
    LG_TRY(status);
    return compare(s, FEW, one, error);
}

/* Fits windows that grow by halves up to `window` rows. Where motion is chaotic, a run of many rows has many
 * minima, and only starts and parameters that already follow most of its rows lead to the right one. */
static lg_status lengthen(stages *s, uint32_t window, tried *one, lg_error *error) {
    uint32_t rows = s->shortest;
    do {
        rows = rows + rows / 2 + 1 < window ? rows + rows / 2 + 1 : window;
        s->compared.window = rows;
        LG_TRY(compare(s, STAGE_EPOCHS, one, error));
    } while (rows < window);
    return LG_OK;
}

/* Logs with positions alone: tries several ways to first parameters and keeps those that predict best. theta,
 * in and out: the parameters of `machine`, then those of all starts. */
static lg_status fit_candidates(lg_training *self, const lg_machine *machine, double *theta,
                                lg_error *error) {
    const lg_machine_state *state = self->state;
    const uint32_t window = state->problem.window;
    stages s = {.self = self, .compared = state->problem, .shortest = window / PART > 2 ? window / PART : 2};
    s.compared.machine = machine;
    s.compared.starts = LG_MACHINE_STARTS_ESTIMATED;
    s.compared.window = s.shortest;
    s.parameters = lg_machine_problem_parameters(&s.compared);
    const double good = expected(&s);
    /* The parameters of a machine that was learned before are the only candidate. */
    size_t i = state->warm != NULL ? LG_COUNT(candidates) - 1 : 0;
    for (; i < LG_COUNT(candidates) && (s.count == 0 || s.all[s.count - 1].loss > good); i++)
        LG_TRY(try_candidate(&s, theta, &candidates[i], error));
    qsort(s.all, s.count, sizeof *s.all, lg_compare_doubles);
    /* Short windows hardly tell good candidates apart when there is much noise. */
    const size_t finalists = s.count < FINALISTS ? s.count : FINALISTS;
    for (i = 0; i < finalists && (i == 0 || s.all[i - 1].loss > good); i++)
        LG_TRY(lengthen(&s, window, &s.all[i], error));
    qsort(s.all, finalists, sizeof *s.all, lg_compare_doubles);
    if (isfinite(s.all[0].loss)) memcpy(theta, s.all[0].theta, s.parameters * sizeof *theta);
    return LG_OK;
}

/* ---- the plain machine: without residuals, changes of friction and spare networks ---- */

/* Whether a term is spare: a residual, friction that changes the coefficients of another term, or a network
 * in a part that also has a term which is not a network. */
static bool is_spare(const lg_machine *machine, const lg_machine_term *term) {
    if (term->part == LG_MACHINE_RESIDUAL || lg_machine_base(machine, term) != NULL) return true;
    bool others = false;
    for (const lg_machine_term *other = NULL; lg_machine_next_term(machine, term->part, &other);)
        others = others || !lg_term_is_network(other);
    return others && lg_term_is_network(term);
}

/* The machine without its spare terms. */
static lg_status make_plain(const lg_machine *machine, lg_machine *out, lg_error *error) {
    *out = *machine;
    out->term_count = 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);)
        if (!is_spare(machine, term)) out->terms[out->term_count++] = *term;
    return lg_machine_init(out, error);
}

/* Damping's parameters below `part` of their initial values become `value` times these. */
static void raise(const lg_machine *machine, const double *initial, double part, double value,
                  double *theta) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_DAMPING, &term);)
        for (size_t k = term->offset; k < term->offset + term->parameters; k++)
            if (initial[k] > 0.0 && fabs(theta[k]) < part * initial[k]) theta[k] = value * initial[k];
}

/* Coefficients are squares of parameters, so a parameter that a fit of the plain machine brought near 0
 * would stay there. Where other friction changes these coefficients, such a parameter begins again. */
static void lift(const lg_machine *machine, const double *initial, double *theta) {
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_DAMPING, &term);)
        if (is_spare(machine, term)) raise(machine, initial, 1.0, 1.0, theta);
}

void lg_machine_revive(const lg_machine *machine, const double *initial, double *theta) {
    raise(machine, initial, 1e-4, 0.1, theta);
}

/* Scales down the last layers of spare networks, so that they begin near 0. */
static void quieten(const lg_machine *machine, double *theta) {
    static const double quiet = 1e-2;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        if (!is_spare(machine, term) || !lg_term_is_network(term)) continue; /* polynomials begin at 0 */
        for (size_t k = lg_mlp_weight_offset(&term->net, term->net.layers - 1); k < term->parameters; k++)
            theta[term->offset + k] *= quiet;
    }
}

/* ---- fits ---- */

/* Windows up to this length do not determine an estimated start; the velocity is then a difference of
 * positions. */
enum { SHORTEST = 3 };

/* The training problem of `machine` with windows of `window` rows. */
static lg_machine_problem windows_of(const lg_training *self, const lg_machine *machine, uint32_t window) {
    lg_machine_problem problem = lg_machine_state_of(self)->problem;
    problem.machine = machine;
    problem.window = window;
    return problem;
}

/* The same with windows of at most `window` rows, whose starts are estimated from positions alone. */
static lg_machine_problem short_windows(const lg_training *self, const lg_machine *machine, uint32_t window) {
    const uint32_t most = lg_machine_run_of(self)->window;
    lg_machine_problem problem = windows_of(self, machine, window < most ? window : most);
    problem.starts =
        lg_machine_state_of(self)->positions ? LG_MACHINE_STARTS_ESTIMATED : LG_MACHINE_STARTS_MEASURED;
    return problem;
}

/* Fits `problem`, of short windows. theta, in and out: the parameters of `machine`; with positions alone the
 * parameters of the starts follow. */
static lg_status fit_some(lg_training *self, lg_machine_problem *problem, uint64_t epochs, double *theta,
                          lg_error *error) {
    /* Priors only hold what short windows leave open. */
    static const double weak = 1e-6;
    problem->residual = weak;
    return fit_stage(self, problem, epochs, WINDOWS_SHARE, theta, error);
}

/* Enlarges the position scale of a coordinate whose positions are predicted much worse, in units of their
 * scale, than its velocities (logs of another program's integrator, a sensor with a lag): both errors then
 * count alike. *changed: a scale was enlarged. */
static lg_status balance(lg_training *self, const lg_machine *machine, const double *theta, bool *changed,
                         lg_error *error) {
    static const double tolerated = 2.0, silent = 1e100;
    lg_machine_model_run *run = self->run;
    lg_machine_state *s = self->state;
    *changed = false;
    if (s->data.file.measured >= LG_MEASURED_VELOCITIES_ONLY) return LG_OK;
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        lg_machine_problem each = short_windows(self, machine, s->problem.window);
        double loss[2];
        each.starts = LG_MACHINE_STARTS_MEASURED;
        for (int k = 0; k < 2; k++) {
            for (uint32_t j = 0; j < machine->coordinate_count; j++)
                each.position_scale[j] = each.velocity_scale[j] = silent;
            if (k == 0) each.position_scale[i] = s->problem.position_scale[i];
            if (k == 1) each.velocity_scale[i] = s->problem.velocity_scale[i];
            LG_TRY(lg_machine_loss(self->context, &each, theta, &loss[k], NULL, error));
        }
        const double q = sqrt(loss[0]), v = sqrt(loss[1]);
        if (!(q > tolerated * v && v > 0.0 && isfinite(q)) || s->noise.position[i] > 0.0) continue;
        run->position_scale[i] = s->problem.position_scale[i] *= q / v;
        *changed = true;
    }
    return LG_OK;
}

const double lg_lag_starts[LG_LAG_STARTS] = {2, 5, 10, 30};

/* Keeps at most `most` of the problem's windows, spread over the log, in `start` (most). */
static void thin(lg_machine_problem *problem, size_t most, size_t *start) {
    if (problem->windows <= most) return;
    for (size_t i = 0; i < most; i++) start[i] = problem->start[lg_spread(i, problem->windows, most)];
    problem->start = start;
    problem->windows = most;
    problem->validation = 0;
}

/* Fits `problem` from `count` starts, which `set` writes into the parameters, and takes the one whose loss is
 * least. losses (count): divided by the least one; 0 where it is not finite. Does nothing if `set` finds no
 * such parameters. */
static lg_status scan(lg_training *self, lg_machine_problem *problem, size_t count,
                      bool (*set)(const lg_machine *machine, size_t start, double *theta), double *theta,
                      double *losses, lg_error *error) {
    const size_t n = lg_machine_problem_parameters(problem);
    double best = INFINITY, *own, *found;
    LG_TRAINING_ARRAY(self, own, n + 1, error);
    if (!set(problem->machine, 0, own)) return LG_OK;
    LG_TRAINING_ARRAY(self, found, n + 1, error);
    for (size_t i = 0; i < count; i++) {
        double loss = 0;
        lg_machine_problem each = *problem;
        memcpy(own, theta, n * sizeof *own);
        (void)set(problem->machine, i, own);
        LG_TRY(fit_some(self, &each, STAGE_EPOCHS, own, error));
        LG_TRY(lg_machine_loss(self->context, problem, own, &loss, NULL, error));
        losses[i] = isfinite(loss) ? loss : 0;
        if (!(loss < best)) continue;
        best = loss;
        memcpy(found, own, n * sizeof *found);
    }
    for (size_t i = 0; i < count && best > 0; i++) losses[i] /= best;
    if (isfinite(best)) memcpy(theta, found, n * sizeof *theta);
    return LG_OK;
}

enum { LONG = 20, SHORT = 5, BRISTLES = 10 };

static bool start_lags(const lg_machine *machine, size_t start, double *theta) {
    static const double least = 0.2;
    return lg_machine_set_lags(machine, lg_lag_starts[start] / least * machine->scales.lag[0], theta) > 0;
}

static bool start_bristles(const lg_machine *machine, size_t start, double *theta) {
    return lg_machine_set_bristles(machine, (start + 0.5) / BRISTLES, theta);
}

static lg_status scan_lags(lg_training *self, lg_machine_problem *problem, double *theta, lg_error *error) {
    return scan(self, problem, LG_LAG_STARTS, start_lags, theta, lg_machine_state_of(self)->lag_ratios,
                error);
}

/* A few windows tell which start is the best. */
static lg_status scan_bristles(lg_training *self, const lg_machine *machine, double *theta, lg_error *error) {
    enum { THINNED = 200 };
    const lg_machine_state *s = self->state;
    double losses[BRISTLES];
    size_t start[THINNED];
    lg_machine_problem problem = short_windows(self, machine, LONG);
    if (!s->positions) thin(&problem, THINNED, start);
    return scan(self, &problem, BRISTLES, start_bristles, theta, losses, error);
}

enum { FEW_EPOCHS = 10 }; /* of fits whose windows the fit of the machine takes again */

/* Copies the parameters of the machine, then those of the starts of the windows in `list`, from or to
 * `own`. */
static void copy_starts(const lg_machine_problem *all, const size_t *list, size_t count, double *theta,
                        double *own, bool back) {
    const size_t shared = all->machine->parameters,
                 each = (lg_machine_problem_parameters(all) - shared) / all->windows;
    /* The unit of a start's numbers depends on the number of windows. */
    const double unit = sqrt((double)all->windows / (double)count);
    memcpy(back ? theta : own, back ? own : theta, shared * sizeof *own);
    for (size_t i = 0; i < count; i++) {
        double *some = own + shared + i * each, *whole = theta + shared + list[i] * each;
        for (size_t k = 0; k < each; k++)
            if (back)
                whole[k] = some[k] / unit;
            else
                some[k] = whole[k] * unit;
    }
}

/* Fits the windows whose loss is not far above the median; `losses` has all. *left: how many are left out. */
static lg_status fit_good(lg_training *self, const lg_machine_problem *all, const double *losses,
                          double *theta, size_t *left, lg_error *error) {
    static const double far = 10;
    double *own;
    size_t *list, *start, count = 0;
    lg_machine_problem good = *all;
    LG_TRAINING_ARRAY(self, own, lg_machine_problem_parameters(all) + all->windows, error);
    LG_TRAINING_ARRAY(self, list, all->windows, error);
    LG_TRAINING_ARRAY(self, start, all->windows, error);
    memcpy(own, losses, all->windows * sizeof *own);
    const double most = far * lg_median(own, all->windows);
    for (size_t w = 0; w < all->windows; w++)
        if (losses[w] <= most) list[count] = w, start[count++] = all->start[w];
    *left = all->windows - count;
    if (count == 0 || *left == 0) return LG_OK;
    good.start = start;
    good.windows = count;
    good.validation = 0;
    copy_starts(all, list, count, theta, own, false);
    LG_TRY(fit_some(self, &good, FEW_EPOCHS, own, error));
    copy_starts(all, list, count, theta, own, true);
    return LG_OK;
}

/* Of accelerations alone: first parameters from the guessed states, then the starts of windows and the
 * parameters together, on windows that grow to the fit's. One window whose start is far off spoils the
 * parameters. The fit leaves such a window out until its start follows from a neighbouring window. */
static lg_status fit_accelerations(lg_training *self, const lg_machine *machine, double *theta,
                                   lg_error *error) {
    enum { ROUNDS = 6 };
    const lg_machine_state *s = self->state;
    lg_machine_problem problem = windows_of(self, machine, 2);
    double *losses;
    size_t left = 1;
    LG_TRAINING_ARRAY(self, losses, problem.windows, error);
    problem.starts = LG_MACHINE_STARTS_MEASURED;
    LG_TRY(fit_some(self, &problem, STAGE_EPOCHS, theta, error));
    for (uint32_t part = 2; part > 0; part--) {
        problem = windows_of(self, machine, s->problem.window / part);
        if (problem.window > SHORTEST) LG_TRY(fit_some(self, &problem, FEW_EPOCHS, theta, error));
    }
    LG_TRY(scan_lags(self, &problem, theta, error));
    for (int round = 0; round < ROUNDS && left > 0; round++) {
        LG_TRY(lg_machine_continue_starts(self->context, &problem, theta, losses, error));
        LG_TRY(fit_good(self, &problem, losses, theta, &left, error));
    }
    return LG_OK;
}

/* With positions alone compares ways to first parameters. Else fits the shortest windows, until the scales of
 * the loss no longer change. */
static lg_status fit_windows(lg_training *self, const lg_machine *machine, double *theta, lg_error *error) {
    enum { ROUNDS = 4 };
    const lg_machine_state *s = self->state;
    bool changed = true;
    lg_machine_problem of_lags = short_windows(self, machine, s->positions || s->noisy ? LONG : SHORT);
    if (machine->accelerations) return fit_accelerations(self, machine, theta, error);
    if (s->positions) {
        LG_TRY(fit_candidates(self, machine, theta, error));
        LG_TRY(scan_lags(self, &of_lags, theta, error));
        return scan_bristles(self, machine, theta, error);
    }
    lg_machine_problem problem = windows_of(self, machine, 2);
    LG_TRY(approach(self, &problem, theta, error));
    LG_TRY(scan_lags(self, &of_lags, theta, error));
    for (int round = 0; round < ROUNDS && changed; round++) {
        problem = short_windows(self, machine, s->noisy ? 5 : 2);
        LG_TRY(fit_some(self, &problem, STAGE_EPOCHS, theta, error));
        LG_TRY(balance(self, machine, theta, &changed, error));
    }
    return scan_bristles(self, machine, theta, error);
}

/* Doubles the substeps until explicit steps come to rest: one step is no longer than the time in which
 * friction stops a motion near rest. */
static lg_status reach_rest(lg_training *self, const lg_machine *machine, const double *theta,
                            lg_error *error) {
    enum { MOST = 32 };
    lg_machine_model_run *run = self->run;
    const lg_machine_state *s = self->state;
    double rate = 0;
    if (run->scheme->kind == LG_SCHEME_VARIATIONAL) return LG_OK;
    LG_TRY(lg_machine_rest_rate(self->context, machine, theta, &s->problem.log, &rate, error));
    while (run->substeps < MOST && run->dt * rate > run->substeps)
        run->substeps = run->substeps <= MOST / 2 ? 2 * run->substeps : MOST;
    if (run->dt * rate > 2.5 * MOST)
        LG_WARN(
            self,
            "friction stops the machine within %.1g of a row, which %d steps per row do not resolve: give "
            "`damping` a larger `width`, or --scheme variational",
            1.0 / (run->dt * rate), MOST);
    return LG_OK;
}

/* Chooses the number of steps between two rows unless it is given: the error of the steps must be small
 * against the loss that the parameters from short windows leave, or below all that matters. */
static lg_status find_substeps(lg_training *self, const lg_machine *machine, const double *theta,
                               lg_error *error) {
    enum { MOST = 4 };
    static const double part = 1e-2;
    lg_machine_model_run *run = self->run;
    lg_machine_state *s = self->state;
    lg_machine_problem problem = windows_of(self, machine, s->problem.window);
    double loss = 0, floor = 0;
    if (self->given(self, "substeps")) return LG_OK;
    if (!s->estimated) problem.starts = LG_MACHINE_STARTS_MEASURED;
    for (run->substeps = 1; run->substeps < MOST; run->substeps++) {
        problem.substeps = run->substeps;
        LG_TRY(lg_machine_loss(self->context, &problem, theta, &loss, &floor, error));
        if (floor <= fmax(LG_MACHINE_FLOOR, part * loss)) break;
    }
    LG_TRY(reach_rest(self, machine, theta, error));
    s->problem.substeps = run->substeps;
    return LG_OK;
}

lg_status lg_machine_warm_up(lg_training *self, double *theta, lg_error *error) {
    const lg_machine *machine = &lg_machine_run_of(self)->machine;
    const lg_machine_state *s = self->state;
    /* Fits of logs without velocities also give the parameters of all starts. */
    const size_t starts = s->estimated ? lg_machine_problem_parameters(&s->problem) - machine->parameters : 0;
    lg_machine *plain;
    double *own, *initial;
    LG_TRAINING_ARRAY(self, initial, machine->parameters + 1, error);
    memcpy(initial, theta, machine->parameters * sizeof *initial);
    LG_TRAINING_ARRAY(self, plain, 1, error);
    LG_TRAINING_ARRAY(self, own, machine->parameters + starts + 1, error);
    LG_TRY(make_plain(machine, plain, error));
    lg_machine_carry(machine, theta, plain, own);
    const uint32_t sticks = plain->sticks;
    plain->sticks = 0; /* at first friction has a width: parameters may be far off */
    if (plain->parameters > 0) LG_TRY(fit_windows(self, plain, own, error));
    plain->sticks = sticks;
    LG_TRY(find_substeps(self, plain, own, error));
    lg_machine_carry(plain, own, machine, theta);
    memcpy(theta + machine->parameters, own + plain->parameters, starts * sizeof *own);
    lift(machine, initial, theta);
    quieten(machine, theta);
    return LG_OK;
}
