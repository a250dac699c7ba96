/* Files of programs: read back to the bit, refusals, damage. test_program_mutants.c has 7000 mutants. */
#include "liegrad/hamiltonian.h"

#include "gradcheck/cases.h"
#include "model/program_mutants.h"

#include "autodiff/ops/op_table.h"

static lg_status read_program(const lg_context *context, const char *path, const lg_read_options *options,
                              lg_error *error) {
    lg_program *program = NULL;
    const lg_status status = lg_program_load(context, path, options, &program, error);
    if (status == LG_OK)
        lg_program_destroy(program);
    else
        assert_null(program);
    return status;
}

static void write_network(const char *path) {
    lg_program *program = zoo_network();
    assert_ok(lg_program_save(NULL, path, program, NULL, NULL));
    lg_program_destroy(program);
}

static const char *fresh(void) {
    return fresh_copy("program.h5", write_network);
}

static void check_round_trip(const lg_program *program, const lg_read_options *options) {
    const char *path = scratch_path("first.h5"), *second = scratch_path("second.h5");
    lg_error error = {LG_OK, ""};
    lg_program *again = NULL;
    assert_ok(lg_program_save(NULL, path, program, NULL, &error));
    assert_told(lg_program_load(NULL, path, options, &again, &told));
    assert_ok(lg_program_save(NULL, second, again, NULL, &error));
    assert_same_bytes(path, second);
    assert_same_results(program, again);
    lg_program_destroy(again);
}

TEST("programs of networks are read back as they were saved") {
    char kind[64];
    lg_program *program = zoo_network(), *again;
    check_round_trip(program, NULL);
    const char *path = scratch_path("provenance.h5");
    const lg_provenance provenance = {.command = "make", .has_seed = true, .seed = 5};
    assert_ok(lg_program_save(NULL, path, program, &provenance, NULL));
    assert_ok(lg_program_load(NULL, path, NULL, &again, NULL));
    assert_ok(lg_model_file_kind(NULL, path, NULL, kind, sizeof kind, NULL));
    assert_string_equal(kind, "program");
    assert_string_equal(lg_program_description(again), ZOO_DESCRIPTION);
    assert_int_equal(lg_program_parameters(again), lg_program_parameters(program));
    for (size_t i = 0; i < lg_program_parameters(program); i++) {
        const lg_parameter_spec a = lg_program_parameter(program, i), b = lg_program_parameter(again, i);
        assert_string_equal(a.name, b.name);
        assert_memory_equal(&a.shape, &b.shape, sizeof a.shape);
        assert_memory_equal(a.values, b.values, lg_shape_count(a.shape) * sizeof(double));
    }
    for (size_t f = 0; f < lg_program_functions(program); f++) {
        size_t na, nb;
        assert_string_equal(lg_program_function_name(program, f), lg_program_function_name(again, f));
        const lg_port *a = lg_program_inputs(program, f, &na), *b = lg_program_inputs(again, f, &nb);
        assert_int_equal(na, nb);
        for (size_t i = 0; i < na; i++) {
            assert_string_equal(a[i].name, b[i].name);
            assert_string_equal(a[i].unit != NULL ? a[i].unit : "", b[i].unit != NULL ? b[i].unit : "");
            assert_memory_equal(&a[i].shape, &b[i].shape, sizeof a[i].shape);
            assert_true(a[i].shared == b[i].shared && a[i].low == b[i].low && a[i].high == b[i].high);
        }
    }
    lg_program_destroy(again);
    lg_program_destroy(program);
}

TEST("every operation that a program can have is read back, with its derivative") {
    const lg_read_options here = without_probe();
    const lg_gradcheck_case *row;
    size_t checked = 0;
    for (size_t i = 0; (row = lg_gradcheck_operation(i)) != NULL; i++) {
        lg_program *program = zoo_operation(row);
        if (program == NULL) continue;
        check_round_trip(program, &here);
        lg_program_destroy(program);
        checked++;
    }
    assert_true(checked > 0);
}

/* Operations that a file may name: leaves, calls, and the operations of the table except those that call
 * functions of the process. */
static bool is_in_files(const char *name) {
    static const char *const others[] = {"input", "parameter", "constant", "call"};
    const lg_op *op = lg_op_named(name);
    for (size_t i = 0; i < LG_COUNT(others); i++)
        if (strcmp(name, others[i]) == 0) return true;
    return op != NULL && op->forward != NULL && op->payload != LG_PAYLOAD_IN_PROCESS;
}

TEST("docs/files.md lists every operation of a program once, and no other") {
    FILE *page = fopen(LG_TEST_DIR "/../docs/files.md", "r");
    size_t listed[LG_OPS_MOST + 1] = {0}, room = 0;
    char *line = NULL;
    bool inside = false;
    assert_non_null(page);
    while (getline(&line, &room, page) >= 0 && !(inside && strncmp(line, "```", 3) == 0)) {
        inside = inside || strncmp(line, "Operations; ", 12) == 0;
        if (!inside || strncmp(line, "| `", 3) != 0) continue;
        *strstr(line + 2, " |") = '\0';
        for (const char *name = strtok(line, "|`, "); name != NULL; name = strtok(NULL, "|`, ")) {
            if (!is_in_files(name)) fail_msg("programs have no operation '%s'", name);
            listed[lg_op_place(lg_op_named(name))]++;
        }
    }
    free(line);
    (void)fclose(page);
    for (uint32_t i = 0; lg_ops[i] != NULL; i++)
        if (is_in_files(lg_ops[i]->name) && listed[i] != 1)
            fail_msg("'%s' is listed %zu times", lg_ops[i]->name, listed[i]);
    assert_int_equal(listed[LG_OPS_MOST], 4); /* those that are not in the table */
}

TEST("an empty program is read back") {
    lg_program_spec spec;
    lg_program *program, *again;
    const char *path = scratch_path("empty.h5");
    lg_program_spec_init(&spec);
    assert_ok(lg_program_begin(NULL, &spec, &program, NULL));
    assert_ok(lg_program_save(NULL, path, program, NULL, NULL));
    assert_ok(lg_program_load(NULL, path, NULL, &again, NULL));
    assert_int_equal(lg_program_functions(again), 0);
    assert_string_equal(lg_program_description(again), "");
    lg_program_destroy(program);
    lg_program_destroy(again);
}

/* ---- damaged files ---- */

TEST("a damaged file is refused") {
    refuse_damaged_files(read_program, fresh(), "");
    survive_changed_bytes(read_program, fresh(), 100);
}

TEST("wrong or missing parts of a file are refused by name") {
    static const damage rows[] = {
        {"functions@order", GONE, LG_FORMAT, ""},
        {"functions@order", TEXT("value ../loss"), LG_FORMAT, "~plain"},
        {"functions@order", WHOLE(3), LG_FORMAT, ""},
        {"parameters@order", GONE, LG_FORMAT, ""},
        {"parameters/theta", GONE, LG_FORMAT, ""},
        {"functions/value", GONE, LG_FORMAT, ""},
        {"parameters/theta", ARRAY(1, 5), LG_FORMAT, "~functions/value"},
        {"parameters/scale", SCALAR(NAN), LG_NOT_FINITE, "~NaN"},
        {"functions/value", ARRAY(1, 100), LG_FORMAT, "integers"},
        {"functions/value", SCALAR(1), LG_FORMAT, "bytes"},
        {"functions/value@sha256", TEXT("0"), LG_FORMAT, "~has changed"},
        /* texts from the file are not printed to the terminal unchanged */
        {"@format", TEXT("\x1b[2J\n"), LG_FORMAT, "?[2J?"},
        {"@format_version", WHOLE(3), LG_VERSION, "up to 2"},
        {"@format_version", WHOLE(1), LG_VERSION, "in format 2 only"},
    };
    refuse_damage(read_program, fresh, rows, LG_COUNT(rows));
}

/* ---- names in functions ---- */

typedef struct changed_function {
    enum { OPERATION, REVISION, INPUT_NAME, INPUT_UNIT } what;
    const char *text;
    uint32_t revision;
    lg_status status;
    const char *word;
} changed_function;

/* Changes something in the function `value` of the file. */
static void change_function_value(const char *path, const lg_program *program, const changed_function *c) {
    lg_function_image *image;
    mutant m;
    size_t size;
    assert_ok(lg_function_image_create(program, 0, &image));
    assert_true(make_mutant(image, &m));
    lg_operation *last = &m.operations[image->operation_count - 1];
    if (c->what == OPERATION) last->name = c->text;
    if (c->what == REVISION) last->revision = c->revision;
    if (c->what == INPUT_NAME) m.in[0].name = c->text;
    if (c->what == INPUT_UNIT) m.in[0].unit = c->text;
    unsigned char *bytes = packed(&m.image, &size);
    replace_dataset(path, "functions/value", H5T_STD_U8LE, H5T_NATIVE_UINT8, 1, (const hsize_t[]){size},
                    bytes);
    free(bytes);
    free_mutant(&m);
    lg_function_image_destroy(image);
}

TEST("names of operations, and names that would become part of C code, are checked") {
    static const changed_function cases[] = {
        {OPERATION, "no_such_operation", 0, LG_FORMAT, "no_such_operation"},
        {OPERATION, "custom", 0, LG_FORMAT, "custom operation"},
        {REVISION, NULL, 2, LG_VERSION, "revision"},
        {REVISION, NULL, 0, LG_FORMAT, "revision"},
        {INPUT_NAME, "int", 0, LG_FORMAT, "word of C"},
        {INPUT_NAME, "__x", 0, LG_FORMAT, "begin"},
        {INPUT_UNIT, "*/ int evil; /*", 0, LG_FORMAT, "comment"},
        {INPUT_UNIT, "m\\", 0, LG_FORMAT, "comment"},
    };
    lg_program *program = zoo_network();
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const char *path = fresh();
        change_function_value(path, program, &cases[i]);
        assert_refused(read_program, path, cases[i].status, cases[i].word, "functions/value");
    }
    lg_program_destroy(program);
}

TEST("texts that are not names are neither packed nor unpacked") {
    static const char *const texts[] = {"x y", "", "a;b", "x\x01y", "../x"};
    const lg_port x = {.name = "xyz", .shape = {1, {1}}};
    lg_operation input = {.name = "input", .revision = 1, .rank = 2, .shape = {{0, 1}, {1, 0}}};
    const uint32_t result = 0;
    lg_function_image image = {.name = "f",
                               .inputs = &x,
                               .input_count = 1,
                               .outputs = &x,
                               .output_count = 1,
                               .operations = &input,
                               .operation_count = 1,
                               .results = &result};
    size_t size, whole, memory = 1 << 16;
    unsigned char *bytes = packed(&image, &whole);
    for (size_t i = 0; i < LG_COUNT(texts); i++) {
        lg_function_image *out;
        lg_error error;
        lg_port bad = x;
        bad.name = texts[i];
        image.inputs = &bad;
        assert_status(lg_function_pack(&image, NULL, &size, &error), LG_INVALID_ARGUMENT);
        assert_non_null(strstr(error.message, "inputs"));
        bytes[3] =
            (unsigned char)" ;\x01.\x7f"[i]; /* before the name are the version, a count and a length */
        assert_status(lg_function_unpack(NULL, "f", bytes, whole, &memory, &out, &error), LG_FORMAT);
        assert_non_null(strstr(error.message, "function 'f': inputs"));
    }
    free(bytes);
}

TEST("invalid bytes of a function are refused with their position") {
    static const struct {
        const char *bytes;
        size_t size;
        lg_status status;
        const char *words;
    } cases[] = {
        {"\x03", 1, LG_VERSION, "function 'f': version"},
        {"\x02\x00\x00\x00\x00", 5, LG_FORMAT, "the one for loops with paths"},
        {"\x02\x00\x00\x01\x00\x00", 6, LG_FORMAT, "the one for loops with paths"},
        {"\x02\x00\x00\x01\x00\x41", 6, LG_FORMAT, "path: there are too many"},
        {"\x01", 1, LG_FORMAT, "inputs: the bytes end too early"},
        {"\x01\x41", 2, LG_FORMAT, "inputs: there are too many"},
        {"\x01\x02\x00", 3, LG_FORMAT, "inputs: there are more entries than the bytes can hold"},
        {"\x01\x00\x00\xff\xff\xff\xff\x7f", 8, LG_FORMAT, "times: a number is too large"},
        {"\x01\x00\x00\xff\xff\xff\xff\xff\xff\xff\xff\xff\x7f", 13, LG_FORMAT,
         "times: a number is too large"},
        {"\x01\x00\x00\x00\x01\x00", 6, LG_FORMAT, "operation 0 (): name: the bytes end too early"},
        {"\x01\x00\x00\x00\x01\x01", 6, LG_FORMAT, "operation 0 (): name: a number is too large"},
        {"\x01\x00\x00\x00\x01\x00\x01s\x01\x80\x80\x01", 12, LG_FORMAT, "operation 0 (s): name"},
        {"\x01\x00\x00\x00\x01\x00\x01s\x01\x40\x09", 11, LG_FORMAT,
         "operation 0 (s): c: a number is too large"},
        {"\x01\x00\x00\x00\x01\x00\x01s\x01\x01\x7f", 11, LG_FORMAT,
         "operation 0 (s): inputs: there are more"},
        {"\x01\x00\x00\x00\x01\x00\x01s\x01\x02\x05", 11, LG_FORMAT,
         "operation 0 (s): shape: there are too many"},
        {"\x01\x00\x00\x00\x01\x00\x01s\x01\x04\xff\xff\xff\xff\xff\xff\xff\xff\xff\x7f", 20, LG_FORMAT,
         "operation 0 (s): i0: a number is too large"},
        {"\x01\x01\x01"
         "a\x01\x00\x00\x00\x00",
         9, LG_FORMAT, "inputs: it has control characters"},
        {"\x01\x00\x00\x00\x00\x00", 6, LG_FORMAT, "end: there are bytes after the end"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_function_image *out = NULL;
        lg_error error;
        size_t memory = 1 << 16;
        const lg_status status =
            lg_function_unpack(NULL, "f", cases[i].bytes, cases[i].size, &memory, &out, &error);
        if (status != cases[i].status || strstr(error.message, cases[i].words) == NULL)
            fail_msg("case %zu: %s: %s", i, lg_status_name(status), error.message);
        assert_true(out == NULL && memory == 1 << 16);
    }
}

TEST("an image takes no more memory than allowed") {
    lg_program *program = zoo_network();
    lg_function_image *image, *out;
    lg_error error;
    size_t size, most = 1 << 20;
    assert_ok(lg_function_image_create(program, 0, &image));
    unsigned char *bytes = packed(image, &size);
    assert_ok(lg_function_unpack(NULL, "f", bytes, size, &most, &out, &error));
    lg_function_image_destroy(out);
    const size_t taken = (1 << 20) - most;
    assert_true(taken > size && taken < 100 * size);
    for (size_t limit = 0; limit <= taken; limit += limit < taken - 64 ? 64 : 1) {
        size_t memory = limit;
        const lg_status status = lg_function_unpack(NULL, "f", bytes, size, &memory, &out, &error);
        assert_int_equal(status, limit < taken ? LG_FORMAT : LG_OK);
        if (status == LG_OK) lg_function_image_destroy(out);
        if (status != LG_OK) assert_non_null(strstr(error.message, "limit"));
        assert_int_equal(memory, status == LG_OK ? 0 : limit);
    }
    size_t room = size - 1;
    assert_status(lg_function_pack(image, bytes, &room, &error), LG_INVALID_ARGUMENT);
    assert_non_null(strstr(error.message, "too small for the bytes"));
    free(bytes);
    lg_function_image_destroy(image);
    lg_program_destroy(program);
}

TEST("a file beyond the limits is refused") {
    lg_read_options options;
    lg_read_options_init(&options);
    options.max_size = 3000; /* each array is smaller, all together are larger */
    lg_error error;
    assert_status(read_program(NULL, fresh(), &options, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "limit"));
}

TEST("a file without a program is refused") {
    lg_error error;
    lg_hamiltonian_file model;
    assert_status(lg_recipe_load(NULL, fresh(), NULL, &lg_recipe_hamiltonian, &model, &error), LG_FORMAT);
    assert_non_null(strstr(error.message, "program"));
}

TEST("a function that does not exist has no image") {
    lg_program *program = zoo_network();
    lg_function_image *image = NULL;
    assert_status(lg_function_image_create(program, lg_program_functions(program), &image), LG_NOT_FOUND);
    lg_program_destroy(program);
}

/* ---- memory ---- */

static lg_status save_and_load(const lg_context *context, void *user, lg_error *error) {
    const lg_read_options here = without_probe();
    lg_program *program = NULL, *again = NULL;
    lg_status status = lg_program_load(context, user, &here, &program, error);
    if (status == LG_OK) status = lg_program_save(context, scratch_path("again.h5"), program, NULL, error);
    if (status == LG_OK) status = lg_program_load(context, scratch_path("again.h5"), &here, &again, error);
    lg_program_destroy(program);
    lg_program_destroy(again);
    return status;
}

TEST("every allocation may fail, and nothing leaks") {
    assert_true(fail_every_allocation(save_and_load, test_text("%s", fresh())) > 50);
}

/* ---- hostile files ---- */

/* A function with one operation on one or two shared inputs. */
/* REFUSED_ASIDE: refused, with a result that is not an output of the function */
typedef enum verdict { SOUND, REFUSED, REFUSED_ASIDE } verdict;
typedef struct attack {
    const char *operation;
    uint32_t inputs;
    lg_shape in[2], out;
    int64_t whole[4];
    double real;
    verdict what;
} attack;

#define MOST 4294967295

static const attack attacks[] = {
    /* Nothing to sum, copy or choose from, but huge counts. */
    {"sum", 1, {{1, {0}}}, {1, {0}}, {MOST, 5, 0, 0}, 0, SOUND},
    {"sum", 1, {{1, {0}}}, {1, {3}}, {3, 0, 1, 0}, 0, SOUND},
    {"broadcast", 1, {{1, {0}}}, {1, {0}}, {MOST, MOST, 0, 0}, 0, SOUND},
    {"max_axis", 1, {{1, {0}}}, {1, {0}}, {MOST, 1, 0, 0}, 0, SOUND},
    {"max_axis", 1, {{1, {0}}}, {1, {1}}, {1, 0, 1, 0}, 0, REFUSED},
    {"argmax_mask", 1, {{1, {0}}}, {1, {0}}, {MOST, 3, 0, 0}, 0, SOUND},
    {"argmax_mask", 1, {{1, {0}}}, {1, {0}}, {1000000, 0, 1, 0}, 0, REFUSED},
    {"sum", 1, {{1, {8}}}, {1, {4}}, {2147483650, 2, 2147483650, 0}, 0, REFUSED},
    /* Tensors without elements, and long loops. */
    {"permute", 1, {{3, {0, 65536, 32768}}}, {3, {65536, 32768, 0}}, {1, 2, 0, 3}, 0, REFUSED},
    {"permute", 1, {{2, {0, 16777217}}}, {2, {16777217, 0}}, {1, 0, 2, 3}, 0, REFUSED},
    {"permute", 1, {{2, {0, 16777217}}}, {2, {16777217, 0}}, {1, 0, 2, 3}, 0, REFUSED_ASIDE},
    {"broadcast", 1, {{1, {0}}}, {2, {0, 16777217}}, {1, 5, 0, 0}, 0, REFUSED_ASIDE},
    {"broadcast", 1, {{1, {1}}}, {4, {65536, 65536, 65536, 65536}}, {65536, 0, 1, 0}, 0, REFUSED_ASIDE},
    {"permute", 1, {{2, {0, 1000}}}, {2, {1000, 0}}, {1, 0, 2, 3}, 0, SOUND},
    {"permute", 1, {{2, {3, 4}}}, {2, {3, 4}}, {0, 0, 0, 0}, 0, REFUSED},
    /* No outputs, but scratch memory that no tensor limits. The first one asks for 2^51 bytes, which is
     * refused when it is run. */
    {"conv1d_input",
     2,
     {{3, {1, 16777216, 0}}, {3, {16777216, 1, 0}}},
     {3, {1, 1, 1}},
     {1, 16777215, 1, 0},
     0,
     SOUND},
    {"conv1d_input",
     2,
     {{3, {1, 1073741824, 1}}, {3, {1073741824, 1, 1}}},
     {3, {1, 1, 1}},
     {1, 1073741823, 1, 0},
     0,
     REFUSED},
    {"conv1d", 2, {{3, {1, 9, 1}}, {3, {3, 1, 1}}}, {3, {1, 7, 1}}, {0, 0, 0, 0}, 0, REFUSED},
    {"conv1d", 2, {{3, {1, 9, 1}}, {3, {3, 1, 1}}}, {3, {1, 13, 1}}, {1, 3, 0, 0}, 0, REFUSED},
    {"conv1d_block", 2, {{3, {1, 9, 1}}, {3, {3, 1, 1}}}, {3, {1, 7, 1}}, {1, 0, 1, 1}, 7, REFUSED},
    {"conv1d_block", 2, {{3, {1, 9, 1}}, {3, {3, 1, 1}}}, {3, {1, 7, 1}}, {1, 0, 1, 1}, 1, SOUND},
    {"avg_pool1d", 1, {{3, {1, 4, 1}}}, {3, {1, 4, 1}}, {0, 1, 0, 0}, 0, REFUSED},
    {"slice", 1, {{1, {4}}}, {1, {4}}, {MOST, 0, 4, 0}, 0, REFUSED},
    {"slice", 1, {{1, {4}}}, {1, {4}}, {0, 2, MOST, 0}, 0, REFUSED},
    {"pad", 1, {{1, {4}}}, {1, {4}}, {0, MOST, 1, 0}, 0, REFUSED},
    {"concat", 2, {{1, {4}}, {1, {4}}}, {1, {8}}, {1, 0, 0, 0}, 0, REFUSED},
    {"matmul", 2, {{2, {2, 2}}, {2, {2, 2}}}, {2, {2, 2}}, {3, 0, 0, 0}, 0, REFUSED},
    {"act", 1, {{1, {4}}}, {1, {4}}, {7, 0, 0, 0}, 0, REFUSED},
    {"act_derivative", 2, {{1, {4}}, {1, {4}}}, {1, {4}}, {1, 9, 1, 0}, 0, REFUSED},
    {"act_derivative", 2, {{1, {4}}, {1, {4}}}, {1, {4}}, {1, 2, 1, 1}, 0, REFUSED},
    {"stumpff", 1, {{2, {3, 1}}}, {2, {3, 10}}, {9, 0, 0, 0}, 0, REFUSED},
    {"centre", 2, {{3, {1, 2, 3}}, {3, {1, 2, 4}}}, {3, {1, 2, 3}}, {0, 0, 0, 0}, 0, REFUSED},
    {"covariance", 3, {{3, {1, 2, 3}}, {1, {2}}}, {3, {1, 2, 4}}, {4, 0, 0, 0}, 0, REFUSED},
    {"covariance", 3, {{3, {1, 2, 3}}, {1, {3}}}, {3, {1, 2, 1}}, {1, 0, 0, 0}, 0, REFUSED},
    {"covariance_root", 2, {{3, {1, 2, 3}}, {1, {2}}}, {3, {1, 3, 3}}, {0, 0, 0, 0}, 0, REFUSED},
    {"lyapunov", 2, {{3, {1, 2, 2}}, {3, {1, 2, 3}}}, {3, {1, 2, 2}}, {0, 0, 0, 0}, 0, REFUSED},
    {"stumpff", 1, {{2, {3, 1}}}, {2, {3, 3}}, {2, 9, 0, 0}, 0, REFUSED},
    {"dexpinv_coef", 1, {{2, {3, 1}}}, {2, {3, 1}}, {0, 9, 0, 0}, 0, REFUSED},
    {"lie", 2, {{2, {3, 3}}, {2, {3, 3}}}, {2, {3, 3}}, {5, 0, 0, 0}, 0, REFUSED},
    {"lie", 2, {{2, {3, 3}}, {2, {3, 3}}}, {2, {3, 3}}, {2, 0, 0, 0}, 0, REFUSED},
    {"lie", 2, {{2, {3, 3}}, {2, {3, 6}}}, {2, {3, 6}}, {0, 0, 0, 0}, 0, REFUSED},
    /* Indices 0 and 4. */
    {"gather", 1, {{1, {4}}}, {1, {2}}, {2, 4, 0, 0}, 0, REFUSED},
    {"gather", 1, {{1, {5}}}, {1, {2}}, {2, 5, 0, 0}, 0, SOUND},
    {"gather", 1, {{1, {5}}}, {1, {3}}, {3, 5, 0, 0}, 0, REFUSED},
    {"scatter", 1, {{1, {2}}}, {1, {4}}, {2, 4, 0, 0}, 0, REFUSED},
    {"scatter", 1, {{1, {2}}}, {1, {5}}, {2, 5, 0, 0}, 0, SOUND},
    {"rowdot", 2, {{2, {5, 0}}, {2, {5, 0}}}, {2, {5, 1}}, {0, 0, 0, 0}, 0, SOUND},
    {"custom", 0, {{0, {0}}}, {0, {0}}, {MOST, 0, 0, 0}, 0, REFUSED},
};

static lg_status attack_with(const attack *a, lg_program *program, lg_error *error) {
    static const uint32_t edges[3] = {0, 1, 0}, indices[2] = {0, 4};
    const uint32_t result = a->what == REFUSED_ASIDE ? 0 : 2;
    static const char *const names[2] = {"a", "b"};
    lg_port in[2], out = {.name = "y", .shape = a->what == REFUSED_ASIDE ? a->in[0] : a->out, .shared = true};
    lg_operation operations[3];
    memset(operations, 0, sizeof operations);
    for (int i = 0; i < 2; i++) {
        in[i] = (lg_port){.name = names[i], .shape = a->in[i], .shared = true};
        operations[i] = (lg_operation){.name = "input", .revision = 1, .rank = a->in[i].rank};
        operations[i].whole[0].base = i;
        for (uint32_t d = 0; d < a->in[i].rank; d++) operations[i].shape[d].base = a->in[i].dims[d];
    }
    operations[2] = (lg_operation){.name = a->operation,
                                   .revision = 1,
                                   .inputs = edges,
                                   .input_count = a->inputs,
                                   .rank = a->out.rank,
                                   .real = a->real};
    if (strcmp(a->operation, "gather") == 0 || strcmp(a->operation, "scatter") == 0) {
        operations[2].indices = indices;
        operations[2].index_count = 2;
    }
    for (int k = 0; k < LG_WHOLE_COUNT; k++) operations[2].whole[k].base = a->whole[k];
    for (uint32_t d = 0; d < a->out.rank; d++) operations[2].shape[d].base = a->out.dims[d];
    const lg_function_image image = {.name = "attack",
                                     .inputs = in,
                                     .input_count = 2,
                                     .outputs = &out,
                                     .output_count = 1,
                                     .operations = operations,
                                     .operation_count = 3,
                                     .results = &result};
    return lg_program_add_image(program, &image, error);
}

TEST("false attributes and shapes are refused, or the program runs quickly") {
    for (size_t i = 0; i < LG_COUNT(attacks); i++) {
        lg_program_spec spec;
        lg_program *program;
        lg_error error = {LG_OK, ""};
        tally t = {0};
        lg_program_spec_init(&spec);
        assert_ok(lg_program_begin(NULL, &spec, &program, NULL));
        const double begun = seconds_now();
        const lg_status status = attack_with(&attacks[i], program, &error);
        /* Where pointers have 32 bits, a tensor without elements may have a shape that cannot be counted. */
        const bool either = attacks[i].what == SOUND && SIZE_MAX == UINT32_MAX;
        if (!either && (status == LG_OK) != (attacks[i].what == SOUND))
            fail_msg("attack %zu on %s: %s %s", i, attacks[i].operation, lg_status_name(status),
                     error.message);
        if (status == LG_OK) run_mutant(program, &t, i);
        if (status != LG_OK) assert_sentence(&error, status, i);
        if (seconds_now() - begun > 60.0) fail_msg("attack %zu took too long", i);
        lg_program_destroy(program);
    }
}

/* ---- mutants ---- */

TEST("a sample of mutated files is refused or runs") {
    mutate_images(400, 1);
    mutate_all_packed(20, 20, 4);
    mutate_arrays(100, 2);
    mutate_bytes(50, 3);
}
