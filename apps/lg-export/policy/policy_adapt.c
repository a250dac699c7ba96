/* The adaptation of a controller: adapt (x, u, next, memory) -> kept as a function of the program,
 * recursive least squares for each velocity alone. The plant's force less the machine's, over a period, is
 * -damping v - coulomb sign(v) + offset - inertia v'. The four numbers are bounded; `range` scales them to
 * at most 1. The memory has, for each velocity, the scaled numbers (4), then their covariance (4, 4). */
#include <math.h>
#include <string.h>

#include "lg-export/policy/policy.h"
#include "liegrad/ops.h"

enum { ADAPT_STREAM = 14, NUMBERS = 4, MEMORY = 20, MOST = LG_POLICY_COORDINATES };
static const double lowest[NUMBERS] = {0, 0, -1, -0.2}, noise = 1e-4;

typedef struct adaptation {
    const export_policy_job *job;
    double scale[MOST], speed[MOST], range[NUMBERS * MOST]; /* Of forces, of velocities, of the numbers. */
    double keep;
} adaptation;

/* ---- the program's function ---- */

static lg_var row_of(lg_tape *tape, const double *numbers) {
    return lg_input_f64(tape, lg_shape2(1, NUMBERS), numbers);
}

static lg_var bounded(lg_tape *tape, lg_var s) {
    static const double ones[NUMBERS] = {-1, -1, -1, -1};
    const lg_var above = lg_max(tape, s, row_of(tape, lowest));
    return lg_neg(tape, lg_max(tape, lg_neg(tape, above), row_of(tape, ones)));
}

/* Moves a number that left its bounds to the bound, and the others to where they are likeliest then; `row`
 * are the rows of the covariance. */
static lg_var stay_inside(const adaptation *a, lg_tape *tape, const lg_var *row, lg_var s) {
    for (uint32_t k = 0; k < NUMBERS; k++) {
        const lg_var by = lg_slice(tape, lg_sub(tape, bounded(tape, s), s), 1, k, 1),
                     per = export_policy_inverse(tape, a->job, lg_slice(tape, row[k], 1, k, 1));
        s = lg_add(tape, s, lg_mul(tape, row[k], lg_mul(tape, by, per)));
    }
    return bounded(tape, s);
}

/* One update of the memory (B, MEMORY) of a velocity: `by` are the derivatives of the force by the numbers,
 * `away` is the force that they should give. */
static lg_var recur(const adaptation *a, lg_tape *tape, lg_var memory, lg_var by, lg_var away) {
    lg_var s = lg_slice(tape, memory, 1, 0, NUMBERS), row[NUMBERS], parts[NUMBERS], grown = LG_NONE;
    for (uint32_t k = 0; k < NUMBERS; k++) {
        row[k] = lg_slice(tape, memory, 1, NUMBERS * (k + 1), NUMBERS);
        parts[k] = lg_rowdot(tape, row[k], by);
    }
    const lg_var Pb = lg_concat(tape, parts, NUMBERS, 1),
                 size = lg_add_scalar(tape, lg_rowdot(tape, Pb, by), noise),
                 rest = lg_sub(tape, away, lg_rowdot(tape, by, s)), gain = lg_div(tape, Pb, size);
    s = lg_add(tape, s, lg_mul(tape, gain, rest));
    for (uint32_t k = 0; k < NUMBERS; k++) /* in this order the covariance stays symmetric, bit by bit */
        row[k] = lg_sub(tape, row[k], lg_div(tape, lg_mul(tape, Pb, parts[k]), size));
    s = stay_inside(a, tape, row, s);
    /* What is not excited is not forgotten: no variance grows beyond the one at the start, which is 1. */
    for (uint32_t k = 0; k < NUMBERS; k++) {
        const lg_var own = lg_slice(tape, row[k], 1, k, 1);
        grown = k == 0 ? own : lg_max(tape, grown, own);
    }
    const lg_var full = lg_ge(tape, grown, lg_input_f64(tape, lg_shape2(1, 1), &a->keep)),
                 factor = lg_add_scalar(tape, lg_scale(tape, full, 1 - 1 / a->keep), 1 / a->keep),
                 next[] = {s, lg_mul(tape, lg_concat(tape, row, NUMBERS, 1), factor)};
    return lg_concat(tape, next, 2, 1);
}

static lg_status record_adapt(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const adaptation *a = user;
    const uint32_t n = (uint32_t)a->job->given;
    const double period = a->job->task->period;
    const lg_var from = export_policy_state(tape, a->job, in[0]),
                 to = export_policy_state(tape, a->job, in[2]),
                 free = lg_program_call(tape, "period", 0, (const lg_var[]){from, in[1]}),
                 force = lg_scale(tape, lg_slice(tape, lg_sub(tape, to, free), 1, n, n), 1 / period);
    lg_var memory[MOST];
    for (uint32_t i = 0; i < n; i++) {
        const double *range = a->range + (size_t)NUMBERS * i, scale = a->scale[i];
        const lg_var v = lg_slice(tape, in[0], 1, n + i, 1), w = lg_slice(tape, in[2], 1, n + i, 1),
                     middle = lg_scale(tape, lg_add(tape, v, w), 0.5),
                     size = lg_add_scalar(tape, lg_abs(tape, middle), 0.01 * a->speed[i]),
                     by[NUMBERS] = {lg_scale(tape, middle, -range[0] / scale),
                                    lg_scale(tape, lg_div(tape, middle, size), -range[1] / scale),
                                    lg_add_scalar(tape, lg_scale(tape, v, 0), range[2] / scale),
                                    lg_scale(tape, lg_sub(tape, w, v), -range[3] / (period * scale))};
        memory[i] =
            recur(a, tape, lg_slice(tape, in[3], 1, MEMORY * i, MEMORY), lg_concat(tape, by, NUMBERS, 1),
                  lg_scale(tape, lg_slice(tape, force, 1, i, 1), 1 / scale));
    }
    out[0] = lg_concat(tape, memory, n, 1);
    return lg_tape_status(tape);
}

static void add_function(const adaptation *a) {
    const export_policy_job *j = a->job;
    const lg_port *control = export_ports_of(j->program, "control").in,
                  *period = export_ports_of(j->program, "period").in;
    lg_port in[] = {control[0],
                    period[1],
                    control[0],
                    {.name = "memory", .shape = lg_shape1(MEMORY * (uint32_t)j->velocities)}};
    in[2].name = "next";
    const lg_function_spec adapt = {
        "adapt", in, 4, &(lg_port){.name = "kept"}, 1, record_adapt, (void *)(uintptr_t)a};
    EXPORT_MUST(j, lg_program_add_function(j->program, &adapt, &error));
}

/* ---- ranges, from a run of the library ---- */

/* Root mean squares over the run of forces (changes of momenta), velocities and accelerations. */
static void find_ranges(const export_policy_job *j, adaptation *a, const export_path *path) {
    const size_t n = j->given;
    const double period = j->task->period;
    for (size_t i = 0; i < n; i++) {
        double force = 0, speed = 0, rate = 0;
        const double *p = path->state + n + i, *v = path->seen + n + i;
        for (size_t k = 0; k < path->periods; k++, p += 2 * n, v += 2 * n) {
            force += pow((p[2 * n] - p[0]) / period, 2);
            rate += pow((v[2 * n] - v[0]) / period, 2);
            speed += pow(v[0], 2);
        }
        const double count = (double)path->periods;
        force = force > 0 ? sqrt(force / count) : 1;
        speed = speed > 0 ? sqrt(speed / count) : 1;
        rate = rate > 0 ? sqrt(rate / count) : 1;
        const double range[NUMBERS] = {2 * force / speed, 2 * force, 2 * force, 4 * force / rate};
        a->scale[i] = export_round(j->source->options, force);
        a->speed[i] = export_round(j->source->options, speed);
        for (int k = 0; k < NUMBERS; k++)
            a->range[NUMBERS * i + (size_t)k] = export_round(j->source->options, range[k]);
    }
}

/* ---- texts ---- */

static void add_words(const adaptation *a) {
    const export_policy_job *j = a->job;
    text *about = &j->source->about;
    lg_text_add(about,
                "adaptation    NAME_adapt finds, by recursive least squares that forget in %g s (--forget):",
                j->source->options->forget);
    for (size_t i = 0; i < j->velocities; i++) {
        const double *r = a->range + NUMBERS * i;
        lg_text_add(
            about,
            " of %s damping 0 to %.3g, Coulomb friction 0 to %.3g, offset -%.3g to %.3g, inertia %.3g "
            "to %.3g;",
            j->task->coordinate[i].velocity, r[0], r[1], r[2], r[2], lowest[3] * r[3], r[3]);
    }
    lg_text_add(about, " a payload whose inertia depends on other coordinates is outside this form\n");
}

/* Adds the golden run of `adapt`: the plant has more damping than the model, and an offset. */
static void add_run(export_policy_job *j, const adaptation *a) {
    const size_t n = j->given, m = j->inputs, width = 4 * n + m;
    double more[2 * MOST];
    export_memory *run = export_policy_keep(j, "adapt", MEMORY * n);
    for (size_t i = 0; i < n; i++) more[i] = a->range[NUMBERS * i + 2], more[n + i] = a->range[NUMBERS * i];
    export_path path = export_loop_run(j, ADAPT_STREAM, NULL, more);
    run->rows = path.periods;
    run->inputs = app_keep(path.periods * width, sizeof *run->inputs);
    for (size_t k = 0; k < path.periods; k++) {
        double *row = run->inputs + k * width;
        memcpy(row, path.seen + k * 2 * n, 2 * n * sizeof *row);
        memcpy(row + 2 * n, path.held + k * m, m * sizeof *row);
        memcpy(row + 2 * n + m, path.seen + (k + 1) * 2 * n, 2 * n * sizeof *row);
    }
    for (size_t i = 0; i < MEMORY * n; i++) run->start[i] = i % MEMORY >= 4 && (i % MEMORY - 4) % 5 == 0;
    export_reals(j->source, &j->source->further_code, "adapt_range", a->range, NUMBERS * n);
    export_policy_start(j, run);
    export_size(j->source, "ADAPT_SIZE", run->numbers, "numbers of memory of the adaptation");
    export_size(j->source, "FOUND", NUMBERS * n, "numbers that the adaptation finds");
}

void export_policy_adapt(export_policy_job *j) {
    adaptation a = {.job = j};
    export_policy_simple(j, "adapt");
    a.keep = export_round(j->source->options, exp(-j->task->period / j->source->options->forget));
    export_path path = export_loop_run(j, ADAPT_STREAM, NULL, NULL);
    find_ranges(j, &a, &path);
    add_function(&a);
    add_run(j, &a);
    add_words(&a);
}
