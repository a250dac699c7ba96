/* Compares recordings as plans: every function of the program, for the recording's number of rows, as three
 * plans with random options, and in a copy of the program that is built from the stored functions. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "autodiff/program/plan.h"
#include "autodiff/program/program_tape.h"
#include "autodiff/random/random.h"
#include "liegrad/program.h"

enum { GUARD = 64, PLANS = 3, DRAWS = 3, MOST_NUMBERS = 200000, A_FILE = 200 };

/* ---- copies of programs ---- */

static bool same_text(const char *a, const char *b) {
    return strcmp(a != NULL ? a : "", b != NULL ? b : "") == 0;
}

static bool same_ports(const lg_port *a, const lg_port *b, size_t count) {
    bool same = true;
    for (size_t i = 0; i < count; i++, a++, b++)
        same = same && same_text(a->name, b->name) && same_text(a->unit, b->unit) && a->shared == b->shared &&
               lg_same_shape(&a->shape, &b->shape) && memcmp(&a->low, &b->low, 2 * sizeof a->low) == 0;
    return same;
}

static bool same_list(const void *a, const void *b, size_t count, size_t size) {
    return count == 0 || (a != NULL && b != NULL && memcmp(a, b, count * size) == 0);
}

static bool same_operation(const lg_operation *a, const lg_operation *b) {
    return same_text(a->name, b->name) && a->revision == b->revision && a->input_count == b->input_count &&
           a->rank == b->rank && a->real_count == b->real_count && a->index_count == b->index_count &&
           memcmp(a->shape, b->shape, sizeof a->shape) == 0 &&
           memcmp(a->whole, b->whole, sizeof a->whole) == 0 &&
           memcmp(&a->real, &b->real, sizeof a->real) == 0 &&
           memcmp(&a->reciprocal, &b->reciprocal, sizeof a->reciprocal) == 0 &&
           same_list(a->inputs, b->inputs, a->input_count, sizeof *a->inputs) &&
           same_list(a->reals, b->reals, a->real_count, sizeof *a->reals) &&
           same_list(a->indices, b->indices, a->index_count, sizeof *a->indices);
}

static bool same_image(const lg_function_image *a, const lg_function_image *b) {
    bool same = same_text(a->name, b->name) && a->input_count == b->input_count &&
                a->output_count == b->output_count && a->operation_count == b->operation_count &&
                a->times == b->times && a->callee == b->callee && a->path_count == b->path_count;
    same = same && same_ports(a->inputs, b->inputs, a->input_count) &&
           same_ports(a->outputs, b->outputs, a->output_count);
    for (size_t i = 0; same && i < a->operation_count; i++)
        same = same_operation(&a->operations[i], &b->operations[i]);
    return same && (a->times > 0 ? same_list(a->carry, b->carry, a->input_count, sizeof *a->carry) &&
                                       same_list(a->path, b->path, a->path_count, sizeof *a->path)
                                 : same_list(a->results, b->results, a->output_count, sizeof *a->results));
}

/* Adds the function to the copy from its bytes, as a file holds them. */
static void take_again(const lg_function_image *image, lg_program *copy) {
    lg_error error = {.message = ""};
    lg_function_image *again = NULL;
    size_t size = 0, memory = (size_t)1 << 30;
    if (lg_function_pack(image, NULL, &size, &error) != LG_OK) stop("not packed: %s", error.message);
    unsigned char *bytes = room(size, 1);
    if (lg_function_pack(image, bytes, &size, &error) != LG_OK ||
        lg_function_unpack(NULL, image->name, bytes, size, &memory, &again, &error) != LG_OK ||
        lg_program_add_image(copy, again, &error) != LG_OK)
        stop("a function is not taken again: %s", error.message);
    if (!same_image(image, again)) stop("function '%s' is another one when it is unpacked", image->name);
    counted.bytes += size;
    counted.operations += image->operation_count;
    lg_function_image_destroy(again);
    free(bytes);
}

static lg_program *taken_again(const lg_program *program) {
    lg_program *copy = empty_program();
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        lg_function_image *image = NULL;
        if (lg_function_image_create(program, f, &image) != LG_OK) stop("no memory");
        take_again(image, copy);
        lg_function_image_destroy(image);
    }
    return copy;
}

static lg_program *saved_and_loaded(const lg_program *program) {
    char path[] = "/tmp/liegrad-random-XXXXXX";
    lg_program *copy = NULL;
    lg_error error = {.message = ""};
    const int file = mkstemp(path);
    if (file < 0 || close(file) != 0 || lg_program_save(NULL, path, program, NULL, &error) != LG_OK ||
        lg_program_load(NULL, path, NULL, &copy, &error) != LG_OK)
        stop("a program is not saved and loaded: %s", error.message);
    (void)unlink(path);
    return copy;
}

static lg_program *again(const lg_program *program, uint64_t number) {
    return number % A_FILE == 0 ? saved_and_loaded(program) : taken_again(program);
}

/* ---- running a plan ---- */

typedef struct run {
    const lg_plan *plan;
    const truth *t;
    lg_dtype dtype;
    size_t size; /* bytes per number */
    void *in[LG_PROGRAM_MAX_PORTS], *out[LG_PROGRAM_MAX_PORTS], *work;
} run;

static void open_run(run *r, const lg_plan *plan, const truth *t, lg_dtype dtype) {
    *r =
        (run){.plan = plan, .t = t, .dtype = dtype, .size = dtype == LG_F64 ? sizeof(double) : sizeof(float)};
    r->work = lg_alloc(NULL, lg_plan_work_size(plan) + GUARD, 1);
    for (size_t i = 0; i < t->inputs; i++) {
        r->in[i] = room(t->in_count[i], r->size);
        lg_kernels_for(dtype)->convert_in(t->in_count[i], lg_node_at(t->tape, t->in[i])->value, r->in[i]);
    }
    for (size_t j = 0; j < t->outputs; j++) r->out[j] = room(t->out_count[j] * r->size + GUARD, 1);
}

static void close_run(run *r) {
    lg_free(NULL, r->work);
    for (size_t i = 0; i < r->t->inputs; i++) free(r->in[i]);
    for (size_t j = 0; j < r->t->outputs; j++) free(r->out[j]);
}

static bool is_filled(const void *memory, size_t from, int with) {
    for (size_t i = 0; i < GUARD; i++)
        if (((const unsigned char *)memory)[from + i] != with) return false;
    return true;
}

/* Runs the plan with work memory and outputs filled with `fill` (0xff is NaN). Returns false if bytes behind
 * them changed. */
static bool evaluate(const run *r, void *const *out, int fill, finding *f) {
    const size_t work = lg_plan_work_size(r->plan);
    memset(r->work, fill, work);
    memset((char *)r->work + work, 0x5a, GUARD);
    for (size_t j = 0; j < r->t->outputs; j++)
        if (out[j] != NULL) memset(out[j], 0xff, r->t->out_count[j] * r->size + GUARD);
    lg_plan_eval(r->plan, (const void *const *)(void *const *)r->in, out, r->work);
    if (!is_filled(r->work, work, 0x5a)) return found(f, false, "the plan writes behind its work memory");
    for (size_t j = 0; j < r->t->outputs; j++)
        if (out[j] != NULL && !is_filled(out[j], r->t->out_count[j] * r->size, 0xff))
            return found(f, false, "the plan writes behind output %zu", j);
    return true;
}

/* The bits must be the same with other contents of the memory, and if only output j is requested. */
static bool same_alone(const run *r, size_t j, finding *f) {
    void *other[LG_PROGRAM_MAX_PORTS] = {NULL};
    other[j] = room(r->t->out_count[j] * r->size + GUARD, 1);
    bool same = evaluate(r, other, 0x00, f);
    if (same && memcmp(other[j], r->out[j], r->t->out_count[j] * r->size) != 0)
        same = found(f, false, "output %zu alone has other bits", j);
    free(other[j]);
    return same;
}

static bool same_again(const run *r, const lg_program *copy, size_t function, const lg_plan_options *options,
                       finding *f) {
    lg_plan *plan = NULL;
    run other;
    lg_error error = {.message = ""};
    if (lg_plan_create(copy, function, options, &plan, &error) != LG_OK)
        return found(f, true, "the program taken again has no plan: %s", error.message);
    open_run(&other, plan, r->t, r->dtype);
    bool same = evaluate(&other, other.out, 0xff, f);
    for (size_t j = 0; same && j < r->t->outputs; j++)
        if (memcmp(other.out[j], r->out[j], r->t->out_count[j] * r->size) != 0)
            same = found(f, false, "output %zu has other bits in the program taken again", j);
    close_run(&other);
    lg_plan_destroy(plan);
    return same;
}

static bool compare(const run *r, finding *f) {
    char sentence[256];
    for (size_t j = 0; j < r->t->outputs; j++)
        if (!explained(r->t, j, r->dtype, r->out[j], sentence, sizeof sentence))
            return found(f, false, "%s", sentence);
    return true;
}

static bool check_plan(const lg_program *program, const lg_program *copy, size_t function,
                       const lg_plan_options *options, const truth *t, uint64_t draw, finding *f) {
    lg_plan *plan = NULL;
    run r;
    lg_error error = {.message = ""};
    if (lg_plan_create(program, function, options, &plan, &error) != LG_OK)
        return found(f, true, "no plan: %s", error.message);
    for (size_t i = 0; i < plan->steps; i++) counted.steps[plan->step[i].kind]++;
    open_run(&r, plan, t, options->dtype);
    const bool good = evaluate(&r, r.out, 0xff, f) && compare(&r, f) &&
                      same_alone(&r, draw % t->outputs, f) && same_again(&r, copy, function, options, f);
    close_run(&r);
    lg_plan_destroy(plan);
    counted.plans++;
    return good;
}

/* ---- plans of repeated recordings ---- */

enum { OF_TAPE = 4 }; /* most outputs of lg_plan_of_tape */

/* Records the function on a dry tape, at the truth's inputs or at zeros. */
static lg_status record_dry(lg_tape *dry, const lg_program *program, size_t function, const truth *t,
                            bool zeros, lg_var *theta, lg_var *out) {
    static const double nothing = 0.0;
    lg_var in[LG_PROGRAM_MAX_PORTS];
    *theta = lg_parameter(dry, lg_shape1(1), &nothing);
    for (size_t i = 0; i < t->inputs; i++) {
        const lg_node *node = lg_node_at(t->tape, t->in[i]);
        double *zero = room(t->in_count[i], sizeof *zero);
        memset(zero, 0, t->in_count[i] * sizeof *zero);
        in[i] = lg_input_f64(dry, node->shape, zeros ? zero : node->value);
        free(zero);
    }
    return lg_program_record(dry, program, function, NULL, in, out);
}

/* Makes a plan of a recording at zeros, repeats the recording at the truth's inputs, and compares. */
static bool check_repeated(const lg_program *program, size_t function, const truth *t, lg_dtype dtype,
                           finding *f) {
    const size_t outputs = t->outputs < OF_TAPE ? t->outputs : OF_TAPE;
    lg_tape_options options;
    lg_tape *dry = NULL;
    lg_plan *plan = NULL;
    lg_var theta, out[LG_PROGRAM_MAX_PORTS];
    lg_error error = {.message = ""};
    const double nothing = 0.0;
    void *data, *got[OF_TAPE];
    char sentence[256];
    lg_tape_options_init(&options);
    options.dtype = dtype;
    if (lg_tape_create(NULL, &options, &dry) != LG_OK) stop("no memory");
    lg_tape_set_dry(dry);
    if (record_dry(dry, program, function, t, true, &theta, out) != LG_OK ||
        lg_plan_of_tape(dry, theta, out, outputs, t->rows, &plan, &data, &error) != LG_OK) {
        (void)found(f, true, "no plan of the tape: %s%s", lg_tape_message(dry), error.message);
        lg_tape_destroy(dry);
        return false;
    }
    lg_tape_repeat(dry);
    bool good = record_dry(dry, program, function, t, false, &theta, out) == LG_OK ||
                found(f, true, "the recording is not repeated: %s", lg_tape_message(dry));
    void *work = lg_alloc(NULL, lg_plan_work_size(plan), 1);
    for (size_t j = 0; j < outputs; j++) got[j] = room(t->out_count[j], sizeof(double));
    if (good) lg_plan_eval(plan, (const void *const[]){&nothing, data}, got, work);
    for (size_t j = 0; good && j < outputs; j++)
        good = explained(t, j, dtype, got[j], sentence, sizeof sentence) || found(f, false, "%s", sentence);
    for (size_t j = 0; j < outputs; j++) free(got[j]);
    lg_free(NULL, work);
    lg_plan_destroy(plan);
    lg_tape_destroy(dry);
    counted.repeated++;
    return good;
}

static lg_plan_options draw_options(lg_rng *rng, size_t rows, int plan) {
    lg_plan_options options;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = plan == 1 ? LG_F32 : plan == 0 || chance(rng, 0.6) ? LG_F64 : LG_F32;
    options.compact = plan == 2 || (plan == 1 && chance(rng, 0.3));
    options.packed = chance(rng, 0.3);
    options.calls = chance(rng, 0.5);
    options.mark_unfit = chance(rng, 0.1);
    return options;
}

static bool check_function(lg_tape *tape, const lg_program *program, const lg_program *copy, size_t function,
                           const recording *r, lg_rng *rng, finding *f) {
    truth t;
    size_t rows = r->rows;
    while (rows > 1 && numbers_of(program, function, rows) > MOST_NUMBERS) rows /= 2;
    for (int draw = 0; draw == 0 || (draw < DRAWS && !t.finite); draw++)
        find_truth(tape, program, function, rows, rng, &t);
    counted.functions++;
    if (!t.finite) counted.unfit++;
    const lg_dtype dtype = chance(rng, 0.6) ? LG_F64 : LG_F32;
    finding repeated;
    if (t.finite && !check_repeated(program, function, &t, dtype, &repeated))
        return found(f, repeated.refused, "%s, %zu rows, %s, repeated: %.300s",
                     lg_program_function_name(program, function), t.rows, dtype == LG_F64 ? "f64" : "f32",
                     repeated.sentence);
    for (int plan = 0; plan < PLANS && t.finite; plan++) {
        const lg_plan_options options = draw_options(rng, rows, plan);
        const uint64_t draw = lg_rng_next(rng);
        finding own;
        if (check_plan(program, copy, function, &options, &t, draw, &own)) continue;
        return found(f, own.refused, "%s, %zu rows, %s%s%s%s: %.300s",
                     lg_program_function_name(program, function), t.rows,
                     options.dtype == LG_F64 ? "f64" : "f32", options.compact ? ", compact" : "",
                     options.packed ? ", packed" : "", options.calls ? ", calls" : "", own.sentence);
    }
    return true;
}

bool check_plans(const recording *r, finding *out) {
    size_t number[MOST_ALL], count;
    lg_program *program = empty_program(), *copy = NULL;
    lg_error error = {.message = ""};
    lg_rng rng;
    lg_tape *tape = NULL;
    bool good = add_recording(program, r, number, &count, &error) ||
                found(out, true, "the recording becomes no program: %.300s", error.message);
    if (good) copy = again(program, r->number);
    if (lg_tape_create(NULL, NULL, &tape) != LG_OK) stop("no memory");
    for (size_t i = 0; good && i < count; i++) {
        lg_rng_seed(&rng, r->number, 100 + i);
        good = check_function(tape, program, copy, number[i], r, &rng, out);
    }
    lg_tape_destroy(tape);
    lg_program_destroy(copy);
    lg_program_destroy(program);
    counted.recordings++;
    return good;
}
