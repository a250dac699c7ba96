/* Programs with errors, as plain data and as files. Each mutant must either be refused, with the status of an
 * invalid file and a printable message, or be a program that runs for any number of rows within the memory it
 * is given. */
#ifndef LG_PROGRAM_MUTANTS_H
#define LG_PROGRAM_MUTANTS_H

#include <time.h>

#include "gradcheck/cases.h"
#include "model/program_zoo.h"

#define MUTANT_BYTES ((size_t)8 << 20) /* limit for a tape */
#define MUTANT_WORK  1e9               /* limit for a plan: operations on numbers */

/* ---- changing one element of a file ---- */

static inline void change_number(const char *path, const char *name, size_t at, double value) {
    hid_t file = open_for_change(path), set = H5Dopen2(file, name, H5P_DEFAULT);
    hid_t type = H5Dget_type(set);
    const bool real = H5Tget_class(type) == H5T_FLOAT;
    hid_t space = H5Dget_space(set);
    const size_t count = (size_t)H5Sget_simple_extent_npoints(space);
    union {
        double *real;
        int64_t *whole;
        void *memory;
    } all = {calloc(count + 1, 8)};
    hid_t memory = real ? H5T_NATIVE_DOUBLE : H5T_NATIVE_INT64;
    assert_true(all.memory != NULL && H5Dread(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, all.memory) >= 0);
    if (real)
        all.real[at] = value;
    else
        all.whole[at] = value >= 0x1p63 ? INT64_MAX : value <= -0x1p63 ? INT64_MIN : (int64_t)value;
    assert_true(H5Dwrite(set, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, all.memory) >= 0);
    free(all.memory);
    assert_true(H5Sclose(space) >= 0 && H5Tclose(type) >= 0 && H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
}

/* ---- running mutants ---- */

typedef struct tally {
    size_t refused, sound, ran;
    double longest; /* longest time of one mutant, in seconds */
    size_t which;
} tally;

static inline double seconds_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static inline void assert_sentence(const lg_error *error, lg_status status, size_t mutant) {
    if (error->status != status || error->message[0] == '\0')
        fail_msg("mutant %zu: %s without a sentence", mutant, lg_status_name(status));
    for (const char *c = error->message; *c != '\0'; c++)
        if ((unsigned char)*c < ' ' || *c == '\x7f') fail_msg("mutant %zu: %s", mutant, error->message);
}

/* Makes the function a plan and runs it on zeros. */
static inline lg_status plan_mutant(const lg_program *program, size_t function, size_t rows, lg_dtype dtype) {
    lg_plan_options options;
    lg_plan *plan;
    lg_error error;
    void *in[64], *out[64];
    size_t inputs, outputs;
    lg_plan_options_init(&options);
    options.rows = rows;
    options.dtype = dtype;
    options.mark_unfit = rows % 2 == 1;
    options.max_size = MUTANT_BYTES;
    options.most_work = MUTANT_WORK;
    const lg_status status = lg_plan_create(program, function, &options, &plan, &error);
    if (status != LG_OK) {
        assert_true(error.message[0] != '\0');
        return status;
    }
    (void)lg_program_inputs(program, function, &inputs);
    (void)lg_program_outputs(program, function, &outputs);
    const size_t size = dtype == LG_F64 ? sizeof(double) : sizeof(float);
    for (size_t i = 0; i < inputs; i++) in[i] = calloc(lg_plan_input_count(plan, i) + 1, size);
    for (size_t j = 0; j < outputs; j++) out[j] = malloc(lg_plan_output_count(plan, j) * size + 1);
    void *work = aligned_alloc(64, lg_plan_work_size(plan));
    memset(work, 0xff, lg_plan_work_size(plan));
    lg_plan_eval(plan, (const void *const *)in, out, work);
    for (size_t i = 0; i < inputs; i++) free(in[i]);
    for (size_t j = 0; j < outputs; j++) free(out[j]);
    free(work);
    lg_plan_destroy(plan);
    return LG_OK;
}

/* A valid mutant must run in both types and for several numbers of rows. Only limits of memory or work, or
 * shapes, may stop it. */
static inline void run_mutant(const lg_program *program, tally *t, size_t mutant) {
    static const size_t rows[] = {1, 2, 7, 300};
    t->sound++;
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        lg_function_image *image;
        assert_ok(lg_function_image_create(program, f, &image));
        /* a loop may run as often as it states; limiting it is up to the caller */
        const bool long_loop = image->times > 100;
        lg_function_image_destroy(image);
        for (size_t r = 0; r < LG_COUNT(rows) && !long_loop; r++) {
            const lg_dtype dtype = mutant % 2 == 0 ? LG_F64 : LG_F32;
            const lg_status planned = plan_mutant(program, f, rows[r], dtype);
            if (planned != LG_OK && planned != LG_SHAPE && planned != LG_OUT_OF_MEMORY &&
                planned != LG_UNSUPPORTED)
                fail_msg("mutant %zu: a plan: %s", mutant, lg_status_name(planned));
            const lg_status status = zoo_run(program, f, rows[r], dtype, mutant, MUTANT_BYTES, NULL);
            t->ran += status == LG_OK;
            if (status != LG_OK && status != LG_SHAPE && status != LG_OUT_OF_MEMORY &&
                status != LG_NOT_DIFFERENTIABLE && status != LG_INVALID_ARGUMENT)
                fail_msg("mutant %zu: %s", mutant, lg_status_name(status));
        }
    }
}

static inline void note_time(tally *t, double begun, size_t mutant) {
    const double seconds = seconds_now() - begun;
    if (seconds > t->longest) {
        t->longest = seconds;
        t->which = mutant;
    }
}

static inline void tell(const char *what, size_t count, const tally *t) {
    print_message("%zu mutants of %s: %zu refused, %zu sound (%zu runs), the longest took %.3f s (%zu)\n",
                  count, what, t->refused, t->sound, t->ran, t->longest, t->which);
    assert_int_equal(t->refused + t->sound, count);
    assert_true(t->refused > 0 && t->sound > 0 && t->ran > 0);
}

/* ---- mutants as plain data ---- */

enum { LONGEST = 4096 };

/* An image whose parts can all be changed. Its lists have room for the longest that an operation may need. */
typedef struct mutant {
    lg_function_image image;
    char name[2][80];
    lg_port in[64], out[64];
    uint32_t results[64], carry[64];
    lg_operation *operations;
    uint32_t (*inputs)[80];
    uint32_t (*indices)[LONGEST];
    double (*reals)[LONGEST];
} mutant;

static inline void free_mutant(mutant *m) {
    free(m->operations);
    free(m->inputs);
    free(m->indices);
    free(m->reals);
}

static inline bool make_mutant(const lg_function_image *from, mutant *m) {
    const size_t n = from->operation_count;
    for (size_t i = 0; i < n; i++)
        if (from->operations[i].real_count >= LONGEST || from->operations[i].index_count >= LONGEST)
            return false;
    memset(m, 0, sizeof *m);
    m->image = *from;
    m->operations = calloc(n + 1, sizeof *m->operations);
    m->inputs = calloc(n + 1, sizeof *m->inputs);
    m->indices = calloc(n + 1, sizeof *m->indices);
    m->reals = calloc(n + 1, sizeof *m->reals);
    for (size_t i = 0; i < n; i++) {
        lg_operation *o = &m->operations[i];
        *o = from->operations[i];
        if (o->input_count > 0) memcpy(m->inputs[i], o->inputs, o->input_count * sizeof(uint32_t));
        if (o->index_count > 0) memcpy(m->indices[i], o->indices, o->index_count * sizeof(uint32_t));
        if (o->real_count > 0) memcpy(m->reals[i], o->reals, o->real_count * sizeof(double));
        o->inputs = m->inputs[i];
        o->indices = m->indices[i];
        o->reals = m->reals[i];
    }
    memcpy(m->in, from->inputs, from->input_count * sizeof *m->in);
    memcpy(m->out, from->outputs, from->output_count * sizeof *m->out);
    if (from->results != NULL) memcpy(m->results, from->results, from->output_count * sizeof *m->results);
    if (from->carry != NULL) memcpy(m->carry, from->carry, from->input_count * sizeof *m->carry);
    m->image.operations = m->operations;
    m->image.inputs = m->in;
    m->image.outputs = m->out;
    m->image.results = m->results;
    m->image.carry = m->carry;
    return true;
}

static inline uint32_t below_n(lg_rng *rng, size_t n) {
    return (uint32_t)lg_rng_below(rng, n);
}

/* A random index below n, but within the room of a mutant's list. */
static inline uint32_t below_room(lg_rng *rng, size_t n) {
    return below_n(rng, n < 64 ? n : 64);
}

#define PICK(rng, list) ((list)[below_n(rng, LG_COUNT(list))])

/* A number at a limit, or near the present number. */
static inline int64_t edge(lg_rng *rng, int64_t now) {
    static const int64_t edges[] = {0,
                                    0,
                                    1,
                                    2,
                                    3,
                                    -1,
                                    4,
                                    7,
                                    8,
                                    9,
                                    1000,
                                    65536,
                                    (1 << 24),
                                    (1 << 24) + 1,
                                    INT32_MAX,
                                    (int64_t)1 << 31,
                                    UINT32_MAX,
                                    (int64_t)1 << 32,
                                    ((int64_t)1 << 32) + 1,
                                    (int64_t)1 << 62,
                                    INT64_MAX,
                                    INT64_MIN};
    return below_n(rng, 3) > 0 ? PICK(rng, edges) : now + (int64_t)below_n(rng, 5) - 2;
}

static inline double odd_real(lg_rng *rng) {
    static const double values[] = {NAN,   INFINITY, -INFINITY, 0.0, -1.0, 0.5,
                                    1e308, 1e-320,   3.0,       6.0, 7.0,  4e9};
    return PICK(rng, values);
}

static const char *const odd_names[] = {
    "",
    "int",
    "x y",
    "a;b",
    "_x",
    "a__b",
    "*/",
    "\"",
    "x\n#include <evil.h>",
    "%s%n",
    "../../x",
    "x\x01",
    "0x",
    "main()",
    "\xff\xfe",
    "y",
    "row",
    "while",
    "a234567890123456789012345678901234567890123456789012345678901234567890"};
static const char *const odd_operations[] = {"leaf",          "",
                                             "custom",        "custom_derivative",
                                             "input",         "parameter",
                                             "constant",      "nothing",
                                             "%s%s%s",        "matmul",
                                             "reshape",       "sum",
                                             "broadcast",     "max_axis",
                                             "argmax_mask",   "slice",
                                             "pad",           "gather",
                                             "scatter",       "concat",
                                             "permute",       "conv1d",
                                             "conv1d_block",  "conv1d_input",
                                             "conv1d_weight", "avg_pool1d",
                                             "pool_place",    "lie",
                                             "stumpff",       "dexpinv_coef",
                                             "act",           "act_derivative",
                                             "mix",           "combine",
                                             "spd_solve",     "rowdot",
                                             "cross"};

static inline lg_affine *some_affine(lg_rng *rng, lg_operation *o) {
    const uint32_t which = below_n(rng, 10);
    if (which < 4) return &o->shape[below_n(rng, o->rank < 4 ? o->rank + 1 : 4)];
    if (which < 9) return &o->whole[below_n(rng, LG_WHOLE_COUNT)];
    return &o->reciprocal;
}

/* Replaces a number by the same new one wherever it is used as a length, so that shapes stay consistent. */
static inline void change_everywhere(mutant *m, lg_rng *rng, lg_operation *o) {
    static const int64_t to[] = {0, 0,    0,     1,       2,       3,         5,         6,
                                 9, 1000, 70000, 1 << 20, 1 << 24, INT32_MAX, UINT32_MAX};
    const uint32_t rank = o->rank < LG_MAX_RANK ? o->rank : LG_MAX_RANK;
    const int64_t old = rank > 0 ? o->shape[below_n(rng, rank)].base : o->whole[0].base;
    const int64_t now = PICK(rng, to);
    const bool whole = below_n(rng, 2) == 0;
    for (size_t i = 0; i < m->image.operation_count; i++) {
        lg_operation *p = &m->operations[i];
        for (uint32_t d = 0; d < LG_MAX_RANK; d++)
            if (d < p->rank && p->shape[d].base == old && p->shape[d].rows == 0) p->shape[d].base = now;
        const bool leaf = strcmp(p->name, "input") == 0 || strcmp(p->name, "parameter") == 0;
        for (uint32_t k = 0; whole && !leaf && k < LG_WHOLE_COUNT; k++)
            if (p->whole[k].base == old && p->whole[k].rows == 0) p->whole[k].base = now;
    }
    for (size_t i = 0; i < m->image.input_count && i < LG_COUNT(m->in); i++)
        for (uint32_t d = 0; d < m->in[i].shape.rank && d < LG_MAX_RANK; d++)
            if (m->in[i].shape.dims[d] == old) m->in[i].shape.dims[d] = (uint32_t)now;
    for (size_t i = 0; i < m->image.output_count && i < LG_COUNT(m->out); i++)
        for (uint32_t d = 0; d < m->out[i].shape.rank && d < LG_MAX_RANK; d++)
            if (m->out[i].shape.dims[d] == old) m->out[i].shape.dims[d] = (uint32_t)now;
}

static inline void change_port(mutant *m, lg_rng *rng) {
    const bool input = below_n(rng, 2) == 0;
    lg_port *p = input ? &m->in[below_room(rng, m->image.input_count)]
                       : &m->out[below_room(rng, m->image.output_count)];
    const uint32_t what = below_n(rng, 6);
    if (what == 0) p->name = PICK(rng, odd_names);
    if (what == 1) p->unit = PICK(rng, odd_names);
    if (what == 2) p->shape.rank = (uint32_t)edge(rng, p->shape.rank);
    if (what == 3) p->shape.dims[below_n(rng, LG_MAX_RANK)] = (uint32_t)edge(rng, 3);
    if (what == 4) p->shared = !p->shared;
    if (what >= 5) *(below_n(rng, 2) == 0 ? &p->low : &p->high) = odd_real(rng);
}

static inline void change_function(mutant *m, lg_rng *rng) {
    lg_function_image *f = &m->image;
    const uint32_t what = below_n(rng, 7);
    if (what == 0) f->name = PICK(rng, odd_names);
    if (what == 1) f->times = (uint32_t)edge(rng, f->times);
    if (what == 2) f->callee = (uint32_t)edge(rng, f->callee);
    if (what == 3) m->carry[below_room(rng, f->input_count)] = (uint32_t)edge(rng, 0);
    if (what == 4) f->input_count = below_n(rng, 4) == 0 ? 65 : below_n(rng, f->input_count + 1);
    if (what == 5) f->output_count = below_n(rng, 4) == 0 ? 65 : below_n(rng, f->output_count + 1);
    if (what >= 6) m->results[below_room(rng, f->output_count)] = (uint32_t)edge(rng, f->operation_count / 2);
}

static inline void change_operation(mutant *m, lg_rng *rng, size_t i) {
    lg_operation *o = &m->operations[i];
    const uint32_t what = below_n(rng, 14);
    if (what == 0) o->name = PICK(rng, odd_operations);
    if (what == 1) o->revision = (uint32_t)edge(rng, o->revision);
    if (what == 2) o->input_count = below_n(rng, 70);
    if (what == 3) m->inputs[i][below_room(rng, o->input_count)] = (uint32_t)edge(rng, (int64_t)i);
    if (what == 4) m->inputs[i][below_room(rng, o->input_count)] = below_n(rng, i);
    if (what == 5) o->rank = below_n(rng, 8) == 0 ? UINT32_MAX : below_n(rng, 6);
    if (what == 6) o->real = odd_real(rng);
    if (what == 7) o->real_count = below_n(rng, 70);
    if (what == 8) m->reals[i][below_n(rng, o->real_count)] = odd_real(rng);
    if (what == 9) o->index_count = below_n(rng, 70);
    if (what == 10) m->indices[i][below_n(rng, o->index_count)] = (uint32_t)edge(rng, 3);
    lg_affine *a = some_affine(rng, o);
    if (what == 11) a->rows = edge(rng, a->rows);
    if (what >= 12) a->base = edge(rng, a->base);
}

static inline void change_image(mutant *m, lg_rng *rng) {
    const size_t changes = 1 + (size_t)below_n(rng, 3);
    for (size_t c = 0; c < changes; c++) {
        const size_t n = m->image.operation_count, i = below_n(rng, n);
        const uint32_t what = below_n(rng, 10);
        if (what == 0 || n == 0)
            change_function(m, rng);
        else if (what == 1)
            change_port(m, rng);
        else if (what < 4)
            change_everywhere(m, rng, &m->operations[i]);
        else
            change_operation(m, rng, i);
    }
}

/* A program with the parameters, and with the functions before number `function`. */
static inline lg_program *copy_until(const lg_program *from, size_t function) {
    lg_parameter_spec list[8];
    lg_program_spec spec;
    lg_program *made;
    lg_program_spec_init(&spec);
    spec.parameter_count = lg_program_parameters(from);
    for (size_t i = 0; i < spec.parameter_count; i++) list[i] = lg_program_parameter(from, i);
    spec.parameters = list;
    assert_ok(lg_program_begin(NULL, &spec, &made, NULL));
    for (size_t f = 0; f < function; f++) {
        lg_function_image *image;
        assert_ok(lg_function_image_create(from, f, &image));
        assert_told(lg_program_add_image(made, image, &told));
        lg_function_image_destroy(image);
    }
    return made;
}

static inline void mutate_function(const lg_program *program, size_t function, size_t mutant_number,
                                   lg_rng *rng, tally *t) {
    lg_function_image *image;
    mutant m;
    lg_error error = {LG_OK, ""};
    assert_ok(lg_function_image_create(program, function, &image));
    if (!make_mutant(image, &m)) fail_msg("a list is too long for a mutant");
    change_image(&m, rng);
    lg_program *made = copy_until(program, function);
    const size_t before = lg_program_functions(made);
    const double begun = seconds_now();
    const lg_status status = lg_program_add_image(made, &m.image, &error);
    if (status == LG_OK) {
        run_mutant(made, t, mutant_number);
    } else {
        t->refused++;
        assert_sentence(&error, status, mutant_number);
        assert_int_equal(lg_program_functions(made), before);
        if (status != LG_INVALID_ARGUMENT && status != LG_SHAPE && status != LG_FORMAT &&
            status != LG_VERSION && status != LG_NOT_FINITE)
            fail_msg("mutant %zu: %s: %s", mutant_number, lg_status_name(status), error.message);
    }
    note_time(t, begun, mutant_number);
    lg_program_destroy(made);
    free_mutant(&m);
    lg_function_image_destroy(image);
}

/* Mutates the network's functions and all registered operations in turn. */
static inline void mutate_images(size_t count, uint64_t seed) {
    tally t = {0};
    lg_program *network = zoo_network(), *programs[512] = {network};
    size_t many = 1;
    const lg_gradcheck_case *row;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL && many < LG_COUNT(programs); i++)
        if ((programs[many] = zoo_operation(row)) != NULL) many++;
    for (size_t i = 0; i < count; i++) {
        lg_rng rng = test_rng(seed, i);
        const lg_program *program = i % 8 == 0 ? network : programs[below_n(&rng, many)];
        mutate_function(program, below_n(&rng, lg_program_functions(program)), i, &rng, &t);
    }
    for (size_t i = 0; i < many; i++) lg_program_destroy(programs[i]);
    tell("decoded lists", count, &t);
}

/* ---- mutants of packed functions ---- */

static inline unsigned char *packed(const lg_function_image *image, size_t *size) {
    lg_error error = {LG_OK, ""};
    assert_told(lg_function_pack(image, NULL, size, &told));
    unsigned char *bytes = malloc(*size);
    assert_ok(lg_function_pack(image, bytes, size, &error));
    return bytes;
}

/* Unpacks the bytes from a block of exactly their size. If that succeeds, the program must run. */
static inline void take_packed(const lg_program *program, size_t function, const unsigned char *bytes,
                               size_t size, tally *t, size_t number) {
    lg_error error = {LG_OK, ""};
    lg_function_image *image = NULL;
    size_t memory = (size_t)8 << 20;
    unsigned char *exact = malloc(size > 0 ? size : 1);
    if (size > 0) memcpy(exact, bytes, size);
    lg_program *made = copy_until(program, function);
    const double begun = seconds_now();
    lg_status status = lg_function_unpack(NULL, "mutant", exact, size, &memory, &image, &error);
    assert_true((status == LG_OK) == (image != NULL) && memory <= (size_t)8 << 20);
    if (status == LG_OK) status = lg_program_add_image(made, image, &error);
    lg_function_image_destroy(image);
    if (status == LG_OK) {
        run_mutant(made, t, number);
    } else {
        t->refused++;
        assert_sentence(&error, status, number);
        assert_non_null(strstr(error.message, image == NULL ? "function 'mutant'" : ""));
    }
    note_time(t, begun, number);
    lg_program_destroy(made);
    free(exact);
}

/* Functions cut at every length, and with changed bytes. */
static inline void mutate_packed(const lg_program *program, size_t changed, uint64_t seed, tally *t,
                                 size_t *count) {
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        lg_function_image *image;
        size_t size;
        lg_rng rng = test_rng(seed, f);
        assert_ok(lg_function_image_create(program, f, &image));
        unsigned char *bytes = packed(image, &size);
        const size_t sound = t->sound;
        for (size_t end = 0; end < size; end++) take_packed(program, f, bytes, end, t, (*count)++);
        assert_int_equal(t->sound, sound);
        for (size_t i = 0; i < changed; i++) {
            const size_t at = below_n(&rng, size);
            const unsigned char byte = bytes[at];
            bytes[at] = below_n(&rng, 2) == 0 ? (unsigned char)lg_rng_next(&rng)
                                              : (unsigned char)(byte ^ 1u << below_n(&rng, 8));
            take_packed(program, f, bytes, size, t, (*count)++);
            bytes[at] = byte;
        }
        free(bytes);
        lg_function_image_destroy(image);
    }
}

/* Mutates the network, and every `step`th registered operation. */
static inline void mutate_all_packed(size_t step, size_t changed, uint64_t seed) {
    tally t = {0};
    size_t count = 0;
    const lg_gradcheck_case *row;
    lg_program *program = zoo_network();
    mutate_packed(program, changed, seed, &t, &count);
    lg_program_destroy(program);
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i += step)
        if ((program = zoo_operation(row)) != NULL) {
            mutate_packed(program, changed, seed + i, &t, &count);
            lg_program_destroy(program);
        }
    tell("packed functions", count, &t);
}

/* ---- mutants of files ---- */

static inline void read_mutant(const char *path, bool probe, tally *t, size_t number) {
    lg_read_options options;
    lg_program *program = NULL;
    lg_error error = {LG_OK, ""};
    lg_read_options_init(&options);
    options.probe = probe;
    options.max_size = (uint64_t)64 << 20;
    const double begun = seconds_now();
    const lg_status status = lg_program_load(NULL, path, &options, &program, &error);
    if (status == LG_OK) {
        run_mutant(program, t, number);
        lg_program_destroy(program);
    } else {
        t->refused++;
        assert_sentence(&error, status, number);
        if (status != LG_FORMAT && status != LG_VERSION && status != LG_NOT_FINITE)
            fail_msg("mutant %zu: %s: %s", number, lg_status_name(status), error.message);
    }
    note_time(t, begun, number);
}

/* A file with the network, also one that was written on another machine, or a file with a registered
 * operation. */
static inline const char *file_to_mutate(size_t number, lg_rng *rng) {
    if (number % 4 == 0) return LG_TEST_DIR "/models/program.h5";
    size_t rows = 0;
    while (lg_gradcheck_operation(rows) != NULL) rows++;
    const size_t row = number % 2 == 0 ? rows : below_n(rng, rows);
    const char *original = scratch_path(test_text("mutate%zu.original", row));
    if (access(original, F_OK) != 0) {
        lg_program *program = row < rows ? zoo_operation(lg_gradcheck_operation(row)) : NULL;
        if (program == NULL) program = zoo_network();
        assert_ok(lg_program_save(NULL, original, program, NULL, NULL));
        const hid_t file = H5Fopen(original, H5F_ACC_RDWR, H5P_DEFAULT);
        for (size_t f = 0; f < lg_program_functions(program); f++) /* without it, changed bytes are read */
            assert_true(H5Adelete_by_name(file,
                                          test_text("functions/%s", lg_program_function_name(program, f)),
                                          "sha256", H5P_DEFAULT) >= 0);
        assert_true(H5Fclose(file) >= 0);
        lg_program_destroy(program);
    }
    return original;
}

typedef struct sets {
    char name[1024][96];
    size_t count;
} sets;

static inline herr_t note_set(hid_t root, const char *name, const H5O_info_t *info, void *user) {
    sets *s = user;
    (void)root;
    if (info->type == H5O_TYPE_DATASET && s->count < LG_COUNT(s->name))
        (void)snprintf(s->name[s->count++], sizeof s->name[0], "%s", name);
    return 0;
}

/* Changes one element of an array, or its length. */
static inline void change_set(const char *path, lg_rng *rng) {
    static sets s;
    s.count = 0;
    hid_t file = open_for_change(path);
    assert_true(H5Ovisit(file, H5_INDEX_NAME, H5_ITER_NATIVE, note_set, &s) >= 0);
    const char *name = s.name[below_n(rng, s.count)];
    hid_t set = H5Dopen2(file, name, H5P_DEFAULT), type = H5Dget_type(set), space = H5Dget_space(set);
    const bool real = H5Tget_class(type) == H5T_FLOAT;
    const size_t count = (size_t)H5Sget_simple_extent_npoints(space);
    assert_true(H5Sclose(space) >= 0 && H5Tclose(type) >= 0 && H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
    if (below_n(rng, 10) == 0) {
        const hsize_t dims[2] = {below_n(rng, 40), 1 + below_n(rng, 4)};
        double data[160];
        for (size_t i = 0; i < LG_COUNT(data); i++) data[i] = (double)below_n(rng, 5);
        replace_dataset(path, name, real ? H5T_IEEE_F64LE : H5T_STD_U32LE, H5T_NATIVE_DOUBLE,
                        1 + (int)below_n(rng, 2), dims, data);
    } else if (count > 0) {
        change_number(path, name, below_n(rng, count), real ? odd_real(rng) : (double)edge(rng, 2));
    }
}

static inline void mutate_arrays(size_t count, uint64_t seed) {
    tally t = {0};
    for (size_t i = 0; i < count; i++) {
        lg_rng rng = test_rng(seed, i);
        const char *path = scratch_path("mutant.h5");
        copy_file(file_to_mutate(i, &rng), path);
        for (size_t c = 0; c <= below_n(&rng, 2); c++) change_set(path, &rng);
        read_mutant(path, false, &t, i);
    }
    tell("arrays in files", count, &t);
}

/* Changes bytes, overwrites runs of bytes, or cuts the file. Most of a file is weights and padding, so many
 * mutants stay valid. */
static inline void mutate_bytes(size_t count, uint64_t seed) {
    tally t = {0};
    for (size_t i = 0; i < count; i++) {
        size_t size;
        lg_rng rng = test_rng(seed, i);
        unsigned char *data = read_bytes_of(file_to_mutate(i, &rng), &size);
        const size_t changes = 1 + (size_t)below_n(&rng, 6);
        for (size_t c = 0; c < changes; c++) {
            const size_t at = below_n(&rng, size), run = below_n(&rng, 4) == 0 ? 1 + below_n(&rng, 16) : 1;
            const unsigned char value = (unsigned char)lg_rng_next(&rng);
            for (size_t b = at; b < at + run && b < size; b++)
                data[b] = c % 2 == 0 ? value : (unsigned char)~data[b];
        }
        if (below_n(&rng, 10) == 0) size -= below_n(&rng, size);
        write_bytes_to(scratch_path("mutant.h5"), data, size);
        read_mutant(scratch_path("mutant.h5"), true, &t, i);
    }
    tell("files", count, &t);
}

#endif
