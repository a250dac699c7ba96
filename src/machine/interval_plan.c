/* Machines of lines and angles: intervals between rows and their derivatives by a plan. Where friction sticks
 * an interval has thousands of operations, and a chunk has few long windows. Recording then takes far longer
 * than the numbers themselves. So the interval and its derivatives are recorded once, and the tape of the fit
 * keeps a plan for each machine, scheme, substeps and hold. */
#include <string.h>

#include "autodiff/program/program.h"
#include "machine/chain.h"

/* Most rows of the plan; most derivatives of an interval; least rows of a long window. */
enum { ROWS = 32, COLUMNS = 64, LONG = 512 };

typedef struct interval_plan {
    struct interval_plan *next;
    const lg_context *context;
    lg_machine machine;
    const lg_scheme *scheme;
    uint32_t substeps, powers;
    uint32_t rows, numbers, columns; /* of the plan; the length of z; the derivatives by z and theta */
    lg_plan *plan;                   /* NULL: it cannot be made */
    void *work;
    double *z, *u, *h, *after, *slopes;
} interval_plan;

static void release(void *kept) {
    for (interval_plan *p = kept, *next; p != NULL; p = next) {
        next = p->next;
        lg_plan_destroy(p->plan);
        LG_FREE_ALL(p->context, p->work, p->z, p->after, p->slopes, p->u, p->h, p);
    }
}

/* ---- recording ---- */

/* Appends the derivatives of `next` along the unit vectors of x, whose last axis is that of its numbers. */
static lg_status differentiate(lg_tape *tape, lg_var next, lg_var x, lg_var *columns) {
    const lg_shape shape = lg_var_shape(tape, x);
    const uint32_t n = shape.dims[shape.rank - 1];
    double e[COLUMNS];
    for (uint32_t j = 0; j < n; j++) {
        memset(e, 0, sizeof e);
        e[j] = 1.0;
        const lg_var along = lg_broadcast_to(tape, lg_input_f64(tape, lg_shape1(n), e), shape);
        LG_TRY(lg_jvp(tape, &next, 1, &x, &along, 1, &columns[j]));
    }
    return lg_tape_status(tape);
}

/* Inputs z, h, u if there are inputs, theta if there are parameters; outputs next z and its derivatives. */
static lg_status record(void *user, lg_tape *tape, const lg_var *parameters, const lg_var *in, lg_var *out) {
    const interval_plan *p = user;
    const lg_machine *machine = &p->machine;
    const uint32_t m = machine->input_count, n = p->numbers;
    const lg_var theta = machine->parameters > 0 ? in[m > 0 ? 3 : 2] : LG_NONE;
    lg_machine_vars vars;
    lg_machine_flow flow;
    lg_var u[4] = {LG_NONE, LG_NONE, LG_NONE, LG_NONE}, parts[LG_TAPED_MAX_PARTS], columns[COLUMNS];
    const lg_machine_problem problem = {.machine = machine, .scheme = p->scheme, .substeps = p->substeps};
    LG_TRY(lg_machine_begin_flow(tape, &problem, theta, &vars, &flow));
    LG_TRY(lg_machine_split_row(tape, &vars, in[0], parts));
    for (uint32_t k = 0; k < p->powers && m > 0; k++) u[k] = lg_machine_columns(tape, in[2], k * m, m);
    LG_TRY(lg_machine_record_interval_of(tape, &flow, u, in[1], parts));
    out[0] = lg_machine_join_row(tape, &vars, parts);
    LG_TRY(differentiate(tape, out[0], in[0], columns));
    if (p->columns > n) LG_TRY(differentiate(tape, out[0], theta, columns + n));
    out[1] = lg_concat(tape, columns, p->columns, 1);
    return lg_tape_status(tape);
}

static lg_status make(interval_plan *p) {
    const lg_machine *machine = &p->machine;
    const uint32_t width = machine->input_count * p->powers;
    lg_port in[4] = {{.name = "z", .shape = lg_shape1(p->numbers), .low = -1, .high = 1},
                     {.name = "h", .shape = lg_shape1(1), .low = 0.01, .high = 0.1}};
    const lg_port out[2] = {{.name = "next"}, {.name = "slopes"}};
    size_t count = 2;
    if (width > 0) in[count++] = (lg_port){.name = "u", .shape = lg_shape1(width), .low = -1, .high = 1};
    if (machine->parameters > 0)
        in[count++] = (lg_port){.name = "theta",
                                .shape = lg_shape1((uint32_t)machine->parameters),
                                .shared = true,
                                .low = 0.1,
                                .high = 1};
    const lg_function_spec function = {"interval", in, count, out, 2, record, p};
    lg_plan_options options;
    lg_program *program;
    LG_TRY(lg_program_of(p->context, &function, 1, &program, NULL));
    lg_plan_options_init(&options);
    options.rows = p->rows;
    lg_status status = lg_plan_create(program, 0, &options, &p->plan, NULL);
    lg_program_destroy(program);
    if (status != LG_OK) return status;
    const size_t numbers = (size_t)p->rows * p->numbers;
    return LG_ALLOC_ALL(p->context, {&p->work, 1, lg_plan_work_size(p->plan)}, LG_ARRAY(p->z, numbers),
                        LG_ARRAY(p->after, numbers), LG_ARRAY(p->slopes, numbers * p->columns),
                        LG_ARRAY(p->u, (size_t)p->rows * width), LG_ARRAY(p->h, p->rows));
}

/* ---- the plans that the tape keeps ---- */

/* Whether a plan takes less time than the tape. Losses of short windows are too soon done. */
static bool pays(const lg_chain *c) {
    const lg_machine_problem *problem = c->problem;
    const lg_machine *machine = problem->machine;
    const bool is_long = problem->window >= LONG, simple = machine->directions + machine->rotations == 0;
    return simple && (is_long || (machine->sticks != 0 && c->columns > 0)) && machine->lags == 0 &&
           machine->bristles == 0 && c->axes.numbers + c->shared <= COLUMNS &&
           problem->scheme->kind != LG_SCHEME_VARIATIONAL;
}

static uint32_t powers_of(const lg_machine_log *log, uint32_t m) {
    for (size_t row = 0; row < log->rows && m > 0; row++)
        for (uint32_t i = m; i < 4 * m; i++)
            if (log->u[row * 4 * m + i] != 0.0) return 4;
    return 1;
}

/* The plan for the chain's machine, made if the tape does not have it; NULL: there is none. */
static const interval_plan *plan_of(lg_chain *c) {
    lg_tape *tape = c->tape;
    const lg_machine_problem *problem = c->problem;
    const lg_machine *machine = problem->machine;
    const uint32_t n = c->axes.numbers, columns = n + (uint32_t)c->shared,
                   rows = c->count < ROWS ? (uint32_t)c->count : ROWS;
    if (!pays(c)) return NULL;
    if (c->powers == 0) c->powers = powers_of(&problem->log, machine->input_count);
    for (interval_plan *p = tape->kept; p != NULL; p = p->next)
        if (p->scheme == problem->scheme && p->substeps == problem->substeps && p->powers == c->powers &&
            p->columns == columns && p->rows >= rows && memcmp(&p->machine, machine, sizeof *machine) == 0)
            return p->plan != NULL ? p : NULL;
    interval_plan *p = lg_alloc(tape->context, 1, sizeof *p);
    if (p == NULL) return NULL;
    *p = (interval_plan){.next = tape->kept,
                         .context = tape->context,
                         .scheme = problem->scheme,
                         .substeps = problem->substeps,
                         .powers = c->powers,
                         .rows = rows,
                         .numbers = n,
                         .columns = columns};
    memcpy(&p->machine, machine, sizeof *machine);
    tape->kept = p;
    tape->release = release;
    if (make(p) == LG_OK) return p;
    lg_plan_destroy(p->plan);
    p->plan = NULL;
    return NULL;
}

/* ---- evaluation ---- */

/* Fills row `to` of the plan's inputs with window s at its row of the log. */
static void fill(const interval_plan *p, const lg_chain *c, size_t s, size_t row, size_t to) {
    const lg_machine *machine = &p->machine;
    const lg_machine_log *log = &c->problem->log;
    const uint32_t m = machine->input_count;
    memcpy(p->z + to * p->numbers, c->z + s * p->numbers, p->numbers * sizeof *p->z);
    p->h[to] = (log->t[row + 1] - log->t[row]) / machine->scales.time;
    for (uint32_t i = 0; i < p->powers * m; i++)
        p->u[to * p->powers * m + i] = log->u[row * 4 * m + i] / machine->scales.input[i % m];
}

/* Takes row `from` of the plan's outputs for window s. */
static void take(const interval_plan *p, lg_chain *c, size_t from, size_t s) {
    const size_t d = c->axes.count, n = p->numbers;
    const double *slopes = p->slopes + from * n * p->columns;
    memcpy(c->next + s * n, p->after + from * n, n * sizeof *c->next);
    for (size_t i = 0; c->columns > 0 && i < d; i++) {
        double *out = c->moved + (s * d + i) * c->columns;
        const size_t at = c->axes.each[i].first;
        for (size_t j = 0; j < d; j++) c->A[(s * d + i) * d + j] = slopes[c->axes.each[j].first * n + at];
        for (size_t j = 0; j < c->shared; j++) out[j] = slopes[(n + j) * n + at];
        memset(out + c->shared, 0, c->own * sizeof *out);
    }
}

bool lg_chain_plan_interval(lg_chain *c) {
    const interval_plan *p = plan_of(c);
    if (p == NULL) return false;
    const double *theta = c->shared > 0 ? c->theta : c->problem->theta;
    const bool driven = p->machine.input_count > 0;
    const void *in[4] = {p->z, p->h, driven ? p->u : theta, theta};
    for (size_t first = 0; first < c->count; first += p->rows) {
        const size_t left = c->count - first, count = left < p->rows ? left : p->rows;
        for (size_t i = 0; i < p->rows; i++) {
            const size_t s = first + (i < count ? i : 0);
            fill(p, c, s, c->at[s], i);
        }
        lg_plan_eval(p->plan, in, (void *const[]){p->after, p->slopes}, p->work);
        for (size_t i = 0; i < count; i++) take(p, c, i, first + i);
    }
    return true;
}
