/* lg-identify generate: makes logs of a machine whose terms are all known. */
#include <math.h>
#include <string.h>

#include "files/frame.h"
#include "lg-identify/identify.h"
#include "liegrad/geometry.h"
#include "machine/files/log_table.h"

typedef struct generate_values {
    const char *out, *excitation;
    lg_reals amplitude, noise, spread;
    double t_end, dt, after_colon; /* after_colon: the number in --excitation NAME:NUMBER; 0: none. */
    uint64_t runs;
} generate_values;

static const lg_field options[] = {
    APP_OUT(generate_values, "LOG.csv", "Write the log", .required = true, .file = LG_FILE_TEXT),
    LG_OPTION(
        generate_values, excitation, STRING, "multisine[:F]|steps[:S]|none|FILE.csv",
        "What the inputs do (default multisine): sines up to F Hz (default one period in 25 rows), steps "
        "of S seconds (default 25 rows), nothing; a file has the columns of time and inputs"),
    LG_OPTION(generate_values, amplitude, REALS, "A,A,...",
              "Amplitude of each input, or one for all (default 1): the largest step, or twice the root mean "
              "square of a multisine",
              LG_ANY_REAL),
    LG_OPTION(generate_values, noise, REALS, "SIGMA[,SIGMA]",
              "Standard deviation of the noise of positions (radians), and of velocities or accelerations "
              "(default the same); not given: the machine's `noise`",
              .high = 1e300, .most = 2),
    LG_OPTION(generate_values, spread, REALS, "S[,S]",
              "Standard deviation of the starts' positions (radians), and of velocities (default 1,1)",
              .option = "start-spread", LG_ANY_REAL, .most = 2),
    APP_RUNS(generate_values, "Runs", .high = 1e6, .value = "10"),
    APP_T_END(generate_values, "Length of a run in seconds (default 10, or the file's)"),
    LG_OPTION(generate_values, dt, REAL, "H", "Seconds from a row to the next", LG_POSITIVE, .value = "0.02"),
    LG_FIELD_END};

static generate_values values = {.excitation = "multisine"};

/* A log that is being made: runs of `rows` rows each; inputs have `delay` further rows, the
 * greatest delay. */
typedef struct making {
    lg_machine_file file;
    size_t runs, rows, delay;
    double t_end;
    double *given;        /* Inputs, (runs, rows + delay, inputs). */
    identify_log made;    /* The runs' initial states and inputs. */
    identify_runs motion; /* The motion of the machine. */
    lg_frame inputs;      /* The times and inputs of FILE.csv. */
    size_t inputs_end;    /* Number of its rows. */
    uint32_t substeps;
    double accuracy;
} making;

/* ---- inputs ---- */

static void multisine(const making *m, lg_rng *rng, double amplitude, double *out) {
    enum { SINES = 8 };
    const size_t inputs = m->file.machine.input_count;
    const double highest = values.after_colon > 0 ? values.after_colon : 1 / (25 * values.dt),
                 each = amplitude / 2 * sqrt(2.0 / SINES);
    for (int s = 0; s < SINES; s++) {
        const double rate = 6.283185307179586 * lg_rng_uniform_in(rng, 0.05, 1) * highest,
                     phase = lg_rng_uniform_in(rng, 0, 6.283185307179586);
        for (size_t row = 0; row < m->rows + m->delay; row++)
            out[row * inputs] += each * sin(rate * values.dt * (double)row + phase);
    }
}

static void steps(const making *m, lg_rng *rng, double amplitude, double *out) {
    const size_t inputs = m->file.machine.input_count;
    const double seconds = values.after_colon > 0 ? values.after_colon : 25 * values.dt;
    const size_t each = (size_t)fmax(1, round(seconds / values.dt));
    double level = 0;
    for (size_t row = 0; row < m->rows + m->delay; row++) {
        if (row % each == 0) level = lg_rng_uniform_in(rng, -amplitude, amplitude);
        out[row * inputs] = level;
    }
}

static const struct {
    const char *name;
    void (*fill)(const making *m, lg_rng *rng, double amplitude, double *out);
} forms[] = {{"multisine", multisine}, {"steps", steps}, {"none", NULL}};

/* Finds the form of --excitation and reads the number after the colon. Returns LG_COUNT(forms) if the value
 * is a file. */
static size_t find_form(void) {
    size_t form = 0;
    for (; form < LG_COUNT(forms); form++) {
        const size_t length = strlen(forms[form].name);
        const char *rest = values.excitation + length;
        if (strncmp(forms[form].name, values.excitation, length) != 0) continue;
        if (rest[0] == '\0') break;
        if (rest[0] != ':' || forms[form].fill == NULL) continue;
        const bool number = lg_number_parse(rest + 1, &values.after_colon) == LG_OK;
        if (!number || !(values.after_colon > 0)) values.after_colon = NAN;
        break;
    }
    return form;
}

/* Reads the times and inputs of FILE.csv. They end before the first time that does not increase. */
static void read_inputs(const app *self, making *m) {
    lg_frame *f = &m->inputs;
    const char *path = values.excitation;
    lg_frame_want *want = app_keep(1 + (size_t)m->file.machine.input_count, sizeof *want);
    *f = (lg_frame){.context = self->context, .path = path, .what = "log", .want = want, .wants = 1};
    const lg_log_column *columns = m->file.columns, *time = &columns[m->file.time];
    want[0] =
        (lg_frame_want){.name = time->name, .as = LG_FRAME_TIME, .scale = time->scale, .complete = true};
    for (uint32_t c = 0; c < m->file.column_count; c++)
        if (columns[c].role == LG_LOG_INPUT)
            want[f->wants++] =
                (lg_frame_want){.name = columns[c].name, .scale = columns[c].scale, .complete = true};
    APP_MUST_FILE(self, path, lg_frame_open(f, &error));
    APP_MUST_FILE(self, path, lg_frame_next(f, SIZE_MAX, &error));
    const double *t = f->value;
    for (m->inputs_end = f->rows > 0; m->inputs_end < f->rows; m->inputs_end++)
        if (!(t[m->inputs_end * f->width] > t[(m->inputs_end - 1) * f->width])) break;
    if (f->cut) app_warn(self, "%s: the last line was cut off and left out", f->shown);
    if (m->inputs_end < f->rows)
        app_warn(self, "%s: %s %zu: the time does not increase: only the rows before it are used", f->shown,
                 f->place, f->line[m->inputs_end]);
    if (m->inputs_end < 2)
        app_stop(self, LG_FORMAT, "%s: inputs need two rows or more whose time rises, but there are %zu",
                 path, m->inputs_end);
    const double length = t[(m->inputs_end - 1) * f->width] - t[0];
    if (!app_given(self, "t-end")) m->t_end = length;
    if (m->t_end > length * (1 + 1e-9) + values.dt)
        app_stop(self, LG_FORMAT,
                 "%s: its times rise for %.4g s, but a run takes %.4g s: give a smaller --t-end", path,
                 length, m->t_end);
}

/* Takes the file's inputs at the times of the rows: held, or interpolated linearly between two rows. */
static void take_inputs(const making *m, size_t run) {
    const lg_frame *f = &m->inputs;
    const size_t inputs = m->file.machine.input_count, all = m->rows + m->delay;
    size_t at = 0;
    for (size_t row = 0; row < all; row++) {
        const double time = f->value[0] + values.dt * (double)row,
                     rounding = 1e-9 * values.dt + 0x1p-51 * fabs(time);
        while (at + 1 < m->inputs_end && f->value[(at + 1) * f->width] <= time + rounding) at++;
        const double *now = f->value + at * f->width, *next = at + 1 < m->inputs_end ? now + f->width : now,
                     s = next > now ? fmin(1, fmax(0, (time - now[0]) / (next[0] - now[0]))) : 0;
        for (uint32_t c = 0, k = 1; c < m->file.column_count; c++) {
            const lg_log_column *column = &m->file.columns[c];
            if (column->role != LG_LOG_INPUT) continue;
            const bool held = m->file.inputs[column->index].hold == LG_HOLD_ZERO;
            const double value = held ? now[k] : now[k] + s * (next[k] - now[k]);
            m->given[(run * all + row) * inputs + column->index] = value;
            k++;
        }
    }
}

static void fill_inputs(const app *self, making *m) {
    const size_t inputs = m->file.machine.input_count, all = m->rows + m->delay, form = find_form(),
                 n = values.amplitude.count;
    for (size_t run = 0; run < m->runs; run++) {
        lg_rng rng;
        lg_rng_seed(&rng, self->seed, 2 * run + 1);
        if (form == LG_COUNT(forms)) take_inputs(m, run);
        for (size_t k = 0; k < inputs && form < LG_COUNT(forms) && forms[form].fill != NULL; k++)
            forms[form].fill(m, &rng, n == 0 ? 1 : values.amplitude.values[n == 1 ? 0 : k],
                             m->given + run * all * inputs + k);
    }
}

/* Fills the log's times, and its inputs as functions of time between the rows. */
static void fill_log(making *m) {
    APP_FREE double *work = app_alloc(3 * m->rows, sizeof *work);
    const size_t inputs = m->file.machine.input_count;
    for (size_t run = 0; run < m->runs; run++) {
        const size_t first = run * m->rows;
        for (size_t row = 0; row < m->rows; row++) m->made.t[first + row] = values.dt * (double)row;
        for (size_t k = 0; k < inputs; k++)
            lg_log_act(m->file.inputs[k].hold, m->rows, m->made.t + first,
                       m->given + run * (m->rows + m->delay) * inputs + k, inputs, inputs, work,
                       m->made.u + 4 * first * inputs + k);
    }
}

/* ---- starts and noise ---- */

/* Returns the number of `by` for positions or for velocities; if `by` has only one number, it is used for
 * both. */
static double one_of(const lg_reals *by, bool velocity, double otherwise) {
    if (by->count == 0) return otherwise;
    return by->values[velocity && by->count > 1 ? 1 : 0];
}

/* Moves a state by normal random numbers. `position` and `velocity` have standard deviations in the order of
 * the velocities: of places, then of rotation angles; a direction has three of these. */
static void scatter(const lg_machine *machine, lg_rng *rng, const double *position, const double *velocity,
                    double *q, double *v) {
    for (lg_machine_offsets at = {0}; lg_machine_next(machine, &at);) {
        double turn[3], turned[9];
        for (uint32_t k = 0; k < at.places; k++) q[k] += position[at.velocity + k] * lg_rng_normal(rng);
        for (uint32_t k = 0; k < 3; k++)
            turn[k] = lg_rng_normal(rng) *
                      (at.places + k < at.velocities ? position[at.velocity + at.places + k] : 0);
        if (at.directions > 0) {
            lg_so3_exp_act(turn, q, turned);
            memcpy(q, turned, 3 * sizeof *q);
        }
        if (at.rotations > 0) {
            lg_so3_exp_multiply(turn, q + at.places, turned);
            memcpy(q + at.places, turned, sizeof turned);
        }
        for (uint32_t k = 0; k < at.velocities; k++) v[k] += velocity[at.velocity + k] * lg_rng_normal(rng);
        if (at.directions > 0) {
            const double along = lg_dot3(v, q);
            for (int k = 0; k < 3; k++) v[k] -= along * q[k];
        }
        q += at.positions, v += at.velocities;
    }
}

static void fill_starts(const app *self, making *m) {
    const lg_machine *machine = &m->file.machine;
    double position[LG_MACHINE_VELOCITIES], velocity[LG_MACHINE_VELOCITIES];
    for (uint32_t i = 0; i < machine->velocities; i++) {
        position[i] = one_of(&values.spread, false, 1);
        velocity[i] = one_of(&values.spread, true, 1);
    }
    for (size_t run = 0; run < m->runs; run++) {
        double *q = m->made.q + run * m->rows * machine->positions;
        lg_rng rng;
        lg_machine_reference(machine, q);
        lg_rng_seed(&rng, self->seed, 2 * run);
        scatter(machine, &rng, position, velocity, q, m->made.v + run * m->rows * machine->velocities);
    }
}

/* Finds the standard deviations of the noise, as for scatter: from the command line, or from the columns in
 * the machine file. Of an attitude the largest counts. */
static void find_noise(const making *m, double *position, double *velocity) {
    const lg_machine_file *file = &m->file;
    for (lg_machine_offsets at = {0}; lg_machine_next(&file->machine, &at);) {
        const lg_log_coordinate *of = &file->coordinates[at.index];
        double turn = 0;
        for (uint32_t c = of->attitude; c < of->attitude + of->attitudes; c++)
            turn = fmax(turn, file->columns[c].noise * (of->attitudes == 4 ? 2 : 1));
        for (uint32_t k = 0; k < at.velocities; k++) {
            const double q = k < of->places ? file->columns[of->place + k].noise : turn,
                         v = k < of->velocities ? file->columns[of->velocity + k].noise : 0;
            position[at.velocity + k] = one_of(&values.noise, false, q);
            velocity[at.velocity + k] = one_of(&values.noise, true, v);
        }
    }
}

static void add_noise(const app *self, making *m) {
    const lg_machine *machine = &m->file.machine;
    double position[LG_MACHINE_VELOCITIES], velocity[LG_MACHINE_VELOCITIES];
    lg_rng rng;
    find_noise(m, position, velocity);
    lg_rng_seed(&rng, self->seed, UINT64_C(1) << 40);
    for (size_t row = 0; row < m->runs * m->rows; row++)
        scatter(machine, &rng, position, velocity, m->motion.q + row * machine->positions,
                m->motion.v + row * machine->velocities);
}

/* ---- the motion ---- */

static double largest_difference(const double *a, const double *b, size_t n) {
    double most = 0;
    for (size_t i = 0; i < n; i++) {
        const double by = fabs(a[i] - b[i]) / (1 + fabs(a[i]));
        most = isfinite(by) ? fmax(most, by) : INFINITY;
    }
    return most;
}

/* Doubles the substeps until the motion changes by at most 1e-10 (at most 512 substeps). The error of a
 * smooth motion falls to a thirtieth each time. Where it falls to more than an eighth, the motion has
 * kinks, such as those of a dead zone, and 1e-6 is enough. */
static void integrate(const app *self, making *m) {
    enum { MOST = 512 };
    static const double wanted = 1e-10, enough = 1e-6;
    const lg_machine *machine = &m->file.machine;
    lg_learned_machine model = {
        .machine = machine, .scheme = lg_scheme_find("rkmk5"), .context = self->context};
    const size_t points = m->runs * m->rows, nq = points * machine->positions,
                 nv = points * machine->velocities;
    APP_FREE double *before_q = app_alloc(nq, sizeof *before_q);
    APP_FREE double *before_v = app_alloc(nv, sizeof *before_v);
    double *q = m->motion.q, *v = m->motion.v;
    m->accuracy = INFINITY;
    bool kinks = false;
    for (m->substeps = 2;; m->substeps *= 2) {
        model.substeps = m->substeps;
        identify_run(self, &model, &m->made.log, m->made.first, m->runs, m->rows - 1, q, v);
        const double last = m->accuracy;
        if (m->substeps > 2)
            m->accuracy = fmax(largest_difference(q, before_q, nq), largest_difference(v, before_v, nv));
        kinks = isfinite(last) && m->accuracy > last / 8;
        if (m->accuracy <= (kinks ? enough : wanted) || m->substeps >= MOST) break;
        memcpy(before_q, q, nq * sizeof *before_q);
        memcpy(before_v, v, nv * sizeof *before_v);
    }
    if (!isfinite(m->accuracy))
        app_stop(self, LG_NOT_FINITE,
                 "%s: the motion is not finite: give a smaller --dt, --amplitude or --start-spread",
                 self->arguments[0]);
    if (m->accuracy > enough)
        app_warn(self,
                 "with %u steps between two rows the motion is accurate to %.1e only: it is chaotic, or --dt "
                 "is too long",
                 m->substeps, m->accuracy);
}

/* ---- the file ---- */

/* The logged value acts its delay later. */
static double input_of(const void *user, size_t run, size_t row, uint32_t input) {
    const making *m = user;
    const size_t acts = row - run * m->rows + m->file.inputs[input].delay;
    return m->given[(run * (m->rows + m->delay) + acts) * m->file.machine.input_count + input];
}

/* ---- the command ---- */

/* Checks that the scene is a machine of which everything is known. */
static void check_scene(const app *self, const lg_machine_file *file) {
    const char *path = self->arguments[0];
    for (const lg_machine_term *term = NULL;
         lg_machine_next_term(&file->machine, LG_MACHINE_PART_COUNT, &term);)
        if (term->parameters > 0)
            app_stop(self, LG_FORMAT,
                     "%s: %s: a term of kind '%s' has no values; in a scene all terms must be known: {kind: "
                     "known, values: ...}",
                     path, lg_machine_part_name(term->part), lg_term_kind_name(term->kind));
    if (values.runs > 1 && file->run >= file->column_count)
        app_stop(self, LG_FORMAT,
                 "%s: %llu runs need a column that tells them apart: give columns: {run: ...}, or --runs 1",
                 path, (unsigned long long)values.runs);
    APP_MUST(self, lg_machine_refuse_momenta(file, path, &error));
}

static void check_options(const app *self, const lg_machine_file *file) {
    const size_t n = values.amplitude.count;
    if (n > 1 && n != file->machine.input_count)
        app_stop_usage(self, "--amplitude: %zu numbers, but the machine has %u inputs", n,
                       file->machine.input_count);
    (void)find_form(); /* Reads the number after the colon. */
    if (isnan(values.after_colon))
        app_stop_usage(self, "--excitation: '%s': expected a number above 0 after the colon",
                       values.excitation);
    if (file->machine.input_count == 0 && find_form() == LG_COUNT(forms))
        app_stop_usage(self, "--excitation: '%s' is a file, but the machine has no inputs",
                       values.excitation);
}

static void begin(const app *self, making *m) {
    const lg_machine *machine = &m->file.machine;
    m->t_end = values.t_end > 0 ? values.t_end : 10;
    if (find_form() == LG_COUNT(forms)) read_inputs(self, m);
    const double times = floor(m->t_end / values.dt + 1 + 1e-9);
    if (!(times <= 1e9))
        app_stop_usage(self, "%g s in steps of --dt %g are more than 1e+09 rows", m->t_end, values.dt);
    m->rows = (size_t)times;
    m->runs = (size_t)values.runs;
    for (uint32_t i = 0; i < machine->input_count; i++)
        if (m->file.inputs[i].delay > m->delay) m->delay = m->file.inputs[i].delay;
    if (m->rows < 2) app_stop_usage(self, "--t-end %g is shorter than --dt %g", m->t_end, values.dt);
    const size_t rows = m->runs * m->rows;
    m->given = app_keep(m->runs * (m->rows + m->delay) * machine->input_count + 1, sizeof *m->given);
    identify_log_begin(&m->made, machine, m->runs, rows);
    for (size_t run = 0; run <= m->runs; run++) m->made.first[run] = run * m->rows;
    m->motion = (identify_runs){m->made.first, m->runs, app_keep(rows * machine->positions, sizeof(double)),
                                app_keep(rows * machine->velocities, sizeof(double)), NULL};
}

static void making_end(making *m) {
    lg_frame_close(&m->inputs);
    lg_machine_file_destroy(&m->file);
}

static void run(app *self) {
    const char *path = self->arguments[0];
    APP_CLEAN(making_end) making m = {.runs = 0};
    const app_path inputs = {"excitation", find_form() < LG_COUNT(forms) ? NULL : values.excitation,
                             LG_FILE_READ, NULL};
    app_check_outputs(self, &inputs, 1);
    APP_FILE(self, path, lg_machine_file_read, &m.file);
    check_scene(self, &m.file);
    check_options(self, &m.file);
    begin(self, &m);
    fill_inputs(self, &m);
    fill_log(&m);
    fill_starts(self, &m);
    integrate(self, &m);
    add_noise(self, &m);
    lg_machine_log log = m.made.log;
    log.q = m.motion.q, log.v = m.motion.v;
    size_t rows;
    (void)identify_write(self, values.out, &m.file, &log, NULL, &m.motion, input_of, &m, &rows);
    app_plot_draw(self, 0, &(identify_plot){"First run", &m.file, &log, 1, .runs = NULL});
    APP_PUT(self->out, LG_WHOLE("runs", m.runs, NULL), LG_WHOLE("rows", rows, "of all runs"),
            LG_REAL("dt", values.dt, "s from a row to the next"),
            LG_WHOLE("substeps", m.substeps, "between two rows"),
            LG_REAL("accuracy", m.accuracy, "of the motion"), LG_AS_WHOLE("seed", self->seed),
            LG_TEXT("out", values.out, NULL));
}

const app_command identify_generate_command = {
    .name = "generate",
    .arguments = "SCENE.yaml",
    .summary = "Make a log of a machine whose terms are all known",
    .details =
        "SCENE.yaml is a machine file: masses, damping and input map of kind known with their values, "
        "potentials {kind: known, form: ..., of: ..., values: ...}. Starts are drawn around 0 (attitudes: "
        "around 1, directions: around e3) with --start-spread and --seed.",
    APP_DRAWS("the first run", "machine", identify_put),
    .settings = APP_SETTINGS(APP_GIVEN(options, values)),
    .run = run};
