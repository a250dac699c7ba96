/* Files are the same bytes on every machine. The constants were found on x86-64; scripts/cross runs this
 * suite where the bytes of a number are in the other order (s390x), and where pointers have 32 bits
 * (i386). */
#include "support/io_test.h"

#include <float.h>

#include "liegrad/hamiltonian.h"
#include "liegrad/model.h"
#include "liegrad/table.h"

static void assert_hash(lg_sha256 *sha, const char *what, const char *expected) {
    char text[LG_SHA256_TEXT];
    lg_sha256_finish(sha, text);
    if (strcmp(text, expected) != 0) fail_msg("%s: %s, expected %s", what, text, expected);
}

/* ---- numbers ---- */

TEST("random numbers, drawn indices and permutations are the same") {
    lg_rng rng = test_rng(7, 3);
    lg_sha256 sha;
    uint32_t items[1000];
    lg_sha256_init(&sha);
    for (int i = 0; i < 1000; i++) {
        const double x = lg_rng_uniform(&rng);
        lg_sha256_add_doubles(&sha, &x, 1);
        items[i] = (uint32_t)lg_rng_below(&rng, 1000000007);
    }
    lg_sha256_add_u32(&sha, items, 1000);
    lg_rng_shuffle(&rng, items, 1000);
    lg_sha256_add_u32(&sha, items, 1000);
    assert_hash(&sha, "1000 draws", "1386a7ff4f9903d90d2ac4c6fade06750eccd321527391720b57f59837179c8a");
}

static const double reals[] = {1.0, -0.1, 1e300, -DBL_MIN, 0x1.23456789abcdep-7, 0.0};
static const float singles[] = {1.0f, -0.1f, 1e30f, 0x1.234568p-7f};
static const int64_t wholes[] = {INT64_MIN, -2, 0x0102030405060708, INT64_MAX};
static const uint64_t naturals[] = {UINT64_MAX, 0x0102030405060708, 0};
static const uint32_t words[] = {UINT32_MAX, 0x01020304, 0};
static const uint8_t octets[] = {255, 1, 0};

TEST("a hash of numbers is that of their bytes from the lowest to the highest") {
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_sha256_add_doubles(&sha, reals, LG_COUNT(reals));
    lg_sha256_add_floats(&sha, singles, LG_COUNT(singles));
    lg_sha256_add_u32(&sha, words, LG_COUNT(words));
    assert_hash(&sha, "numbers", "b95c668a360f3bfc82a8ba308aecb814a3b3e0a5509a52b342a46c09f8a97698");
}

/* ---- HDF5 ---- */

static const struct {
    const char *name;
    lg_element type;
    size_t count;
    const void *values;
    size_t size;
} arrays[] = {{"f64", LG_ELEMENT_F64, LG_COUNT(reals), reals, sizeof reals},
              {"group/f32", LG_ELEMENT_F32, LG_COUNT(singles), singles, sizeof singles},
              {"i64", LG_ELEMENT_I64, LG_COUNT(wholes), wholes, sizeof wholes},
              {"u64", LG_ELEMENT_U64, LG_COUNT(naturals), naturals, sizeof naturals},
              {"group/u32", LG_ELEMENT_U32, LG_COUNT(words), words, sizeof words},
              {"u8", LG_ELEMENT_U8, LG_COUNT(octets), octets, sizeof octets}};

static void write_all(const char *path) {
    lg_h5 *h5;
    assert_ok(lg_h5_create(NULL, path, &h5, NULL));
    for (size_t i = 0; i < LG_COUNT(arrays); i++)
        assert_ok(lg_h5_put(h5, arrays[i].name, arrays[i].type, 1, &(uint64_t){arrays[i].count},
                            arrays[i].values, NULL));
    assert_ok(lg_h5_put_texts(h5, "texts", "one\0two\0", 4, 2, NULL));
    assert_ok(lg_h5_put_text(h5, "group", "text", "a text", NULL));
    assert_ok(lg_h5_put_number(h5, "", "real", LG_ELEMENT_F64, &reals[1], NULL));
    assert_ok(lg_h5_put_number(h5, "group", "whole", LG_ELEMENT_I64, &wholes[1], NULL));
    assert_ok(lg_h5_put_number(h5, "u64", "natural", LG_ELEMENT_U64, &naturals[1], NULL));
    assert_ok(lg_h5_commit(h5, NULL));
    lg_h5_close(h5);
}

static void check_all(const char *path) {
    lg_h5 *h5;
    double real;
    int64_t whole;
    uint64_t natural;
    assert_ok(lg_h5_open(NULL, path, NULL, &h5, NULL));
    for (size_t i = 0; i < LG_COUNT(arrays); i++) {
        void *found = lg_test_memory(arrays[i].size);
        assert_ok(
            lg_h5_get(h5, arrays[i].name, arrays[i].type, 1, &(uint64_t){arrays[i].count}, found, NULL));
        assert_memory_equal(found, arrays[i].values, arrays[i].size);
    }
    assert_ok(lg_h5_number(h5, "", "real", LG_ELEMENT_F64, &real, NULL));
    assert_ok(lg_h5_number(h5, "group", "whole", LG_ELEMENT_I64, &whole, NULL));
    assert_ok(lg_h5_number(h5, "u64", "natural", LG_ELEMENT_U64, &natural, NULL));
    assert_true(real == reals[1] && whole == wholes[1] && natural == naturals[1]);
    lg_h5_close(h5);
}

/* With LG_WRITE_GOLDEN the file of the tree is written again. */
TEST("numbers of every type are written to HDF5 with the bytes that x86-64 writes, and read from them") {
    const char *golden = LG_TEST_DIR "/golden/other_machines.h5", *here = scratch_path("here.h5");
    unsigned version[3];
    assert_true(H5get_libversion(&version[0], &version[1], &version[2]) >= 0);
    if (getenv("LG_WRITE_GOLDEN") != NULL) write_all(golden);
    write_all(here);
    check_all(golden);
    check_all(here);
    if (version[0] == 1 && version[1] == 10)
        assert_same_bytes(golden, here); /* HDF5 wrote `golden` with 1.10.8 */
}

TEST("files of every kind that x86-64 wrote give the same numbers") {
    static const struct {
        const char *name, *hash;
    } files[] = {{"chain", "a8e19b594ea0c87ec550a401b7ddc1292a03b1fd317e1ad8c6d91db95bdd811c"},
                 {"separable", "262c4bf055396d8a7332f316984e2bf3ece72fdb76105dac1b10ad0272389fb4"},
                 {"discrete", "c3f6461118c83ab17462acee21a062aded5d66f7dd7a5b1dac9219103ce39a4e"},
                 {"continuous", "d884be09dc5d17c5b6cc1b03d5c401907cd1846d4c8bae4bb6ba0c1904770772"},
                 {"angle", "3f89a0dadbf4476135dba839195f0e40880bb2a7f942e5e2cab202c337a113da"},
                 {"detector", "1b1c6c239dde85b1dfcb5fc1200344401a9cd6ad272c4ebb3c5d625cf80e10aa"},
                 {"table", "500b70e05f7294dc64f0d096462dcf10b97b2e0a45525191e7b665253f700237"},
                 {"machine", "02caf31a9ee42b3b8d66d6258a46d59e35b2731e3100c4790c5bd61a0111d83c"},
                 {"table-classes", "141f699aeebb975a4c20527b9ee608c4ba57ba9c5d86cfa4de922db080364bbb"}};
    for (size_t i = 0; i < LG_COUNT(files); i++) {
        const char *path = test_text("%s/models/%s.h5", LG_TEST_DIR, files[i].name);
        lg_model_file file;
        lg_slice_info slice;
        const double *values;
        lg_sha256 sha;
        lg_sha256_init(&sha);
        assert_told(lg_model_load(NULL, path, NULL, &file, &told));
        for (uint32_t k = 0; lg_model_file_slice(&file, k, &slice, &values); k++)
            lg_sha256_add_doubles(&sha, values, slice.count);
        lg_model_file_destroy(&file);
        assert_hash(&sha, files[i].name, files[i].hash);
    }
}

/* ---- programs ---- */

static void hash_function(lg_sha256 *sha, const lg_program *program, size_t function) {
    lg_function_image *image;
    size_t size;
    assert_ok(lg_function_image_create(program, function, &image));
    assert_ok(lg_function_pack(image, NULL, &size, NULL));
    void *packed = lg_test_memory(size);
    assert_ok(lg_function_pack(image, packed, &size, NULL));
    lg_sha256_add(sha, packed, size);
    lg_function_image_destroy(image);
}

TEST("programs that x86-64 wrote have the same functions and numbers, packed into the same bytes") {
    static const struct {
        const char *name, *hash;
    } files[] = {{"program", "8a7745886d7c357574d4e81ff56a1fc03cebf705b7482bd71895fdbe020ec17e"},
                 {"program-calls", "f13cfd8c553e424d1acfbc4098e1424ed519f7490525b4f5c4b7c60cc4c3ee19"}};
    for (size_t i = 0; i < LG_COUNT(files); i++) {
        lg_program *program;
        lg_sha256 sha;
        lg_sha256_init(&sha);
        assert_told(lg_program_load(NULL, test_text("%s/models/%s.h5", LG_TEST_DIR, files[i].name), NULL,
                                    &program, &told));
        for (size_t k = 0; k < lg_program_functions(program); k++) hash_function(&sha, program, k);
        for (size_t k = 0; k < lg_program_parameters(program); k++) {
            const lg_parameter_spec p = lg_program_parameter(program, k);
            lg_sha256_add_doubles(&sha, p.values, lg_shape_count(p.shape));
        }
        lg_program_destroy(program);
        assert_hash(&sha, files[i].name, files[i].hash);
    }
}

TEST("the numbers of a program become the same C") {
    lg_program *program;
    lg_c_options options;
    lg_c_source *source;
    lg_sha256 sha;
    lg_sha256_init(&sha);
    lg_c_options_init(&options);
    options.name = "p";
    assert_ok(lg_program_load(NULL, LG_TEST_DIR "/models/program.h5", NULL, &program, NULL));
    assert_told(lg_program_write_c(program, &options, &source, &told));
    lg_sha256_add(&sha, source->weights, strlen(source->weights));
    lg_c_source_destroy(source);
    lg_program_destroy(program);
    assert_hash(&sha, "weights of program.h5",
                "a5761047aa0f48011613411c3c0da5f7538390b1c7da3e9096dc4cc8366ea7e9");
}

/* ---- files of other programs ---- */

static void check_npy(const char *type, size_t size, const unsigned char *numbers, const double *expected) {
    static const char *const names[] = {"c0"};
    const char *header = test_text("{'descr': '%s', 'fortran_order': False, 'shape': (2,), }\n", type);
    unsigned char file[256] = {0x93, 'N', 'U', 'M', 'P', 'Y', 1, 0, (unsigned char)strlen(header), 0};
    memcpy(file + 10, header, strlen(header));
    memcpy(file + 10 + strlen(header), numbers, 2 * size);
    write_bytes_to(scratch_path("a.npy"), file, 10 + strlen(header) + 2 * size);
    lg_table_data data;
    assert_told(lg_table_read(NULL, scratch_path("a.npy"), names, 1, NULL, NULL, &data, &told));
    if (data.values[0] != expected[0] || data.values[1] != expected[1])
        fail_msg("%s: %g and %g, expected %g and %g", type, data.values[0], data.values[1], expected[0],
                 expected[1]);
    lg_table_data_destroy(&data);
}

TEST("numpy's numbers are read in both orders of bytes") {
    static const unsigned char f8[] = {0, 0, 0, 0, 0, 0, 0xf8, 0x3f, 0, 0, 0, 0, 0, 0, 0, 0xc0},
                               f4[] = {0, 0, 0xc0, 0x3f, 0, 0, 0, 0xc0}, i2[] = {0x02, 0x01, 0xfe, 0xff},
                               u4[] = {4, 3, 2, 1, 0xff, 0xff, 0xff, 0xff}, i1[] = {7, 0xff};
    static const struct {
        const char *type; /* without the order */
        size_t size;
        const unsigned char *little;
        double expected[2];
    } cases[] = {{"f8", 8, f8, {1.5, -2}},
                 {"f4", 4, f4, {1.5, -2}},
                 {"i2", 2, i2, {258, -2}},
                 {"u4", 4, u4, {16909060, 4294967295.0}}};
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        const size_t size = cases[i].size;
        unsigned char big[16];
        for (size_t k = 0; k < 2 * size; k++) big[k] = cases[i].little[k / size * size + size - 1 - k % size];
        check_npy(test_text("<%s", cases[i].type), size, cases[i].little, cases[i].expected);
        check_npy(test_text(">%s", cases[i].type), size, big, cases[i].expected);
    }
    check_npy("|i1", 1, i1, (const double[]){7, -1});
}

TEST("tensors of every type are read from their bytes") {
    static const char header[] = "{\"a\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[0,8]},"
                                 "\"b\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[8,12]},"
                                 "\"c\":{\"dtype\":\"F16\",\"shape\":[1],\"data_offsets\":[12,14]},"
                                 "\"d\":{\"dtype\":\"BF16\",\"shape\":[1],\"data_offsets\":[14,16]}}";
    static const unsigned char numbers[] = {0, 0, 0,    0,    0,    0,    0xf8, 0x3f,
                                            0, 0, 0x20, 0xc0, 0x80, 0x43, 0x50, 0xc0};
    static const double expected[] = {1.5, -2.5, 3.75, -3.25};
    unsigned char file[8 + sizeof header + sizeof numbers] = {(unsigned char)(strlen(header) & 255),
                                                              (unsigned char)(strlen(header) >> 8)};
    memcpy(file + 8, header, strlen(header));
    memcpy(file + 8 + strlen(header), numbers, sizeof numbers);
    write_bytes_to(scratch_path("t.safetensors"), file, 8 + strlen(header) + sizeof numbers);
    lg_tensors tensors;
    assert_told(lg_tensors_read(NULL, scratch_path("t.safetensors"), &tensors, &told));
    assert_int_equal(tensors.count, 4);
    for (size_t i = 0; i < 4; i++) assert_close(tensors.tensor[i].values[0], expected[i], 0, 0);
    lg_tensors_destroy(&tensors);
}

/* ---- states of FMUs ---- */

/* What lg-export writes above fmu_core.c: a model without states that has one input and one output. */
enum { STATES = 0, NUMBERS = 3, PORTS = 2, WORK = 1 };
enum { CAUSALITY_STATE, CAUSALITY_INPUT, CAUSALITY_OUTPUT, CAUSALITY_PARAMETER };
#define HAS_STATES 0
#define TOKEN      "a token"
static const struct {
    int at, count, causality;
} ports[] = {{0, 2, CAUSALITY_INPUT}, {2, 1, CAUSALITY_OUTPUT}};
static const double start_values[NUMBERS] = {1, 2, 3};
static void evaluate(const double *in, double *out, double *work) {
    out[2] = in[0] + in[1] + 0 * work[0];
}
#pragma GCC diagnostic ignored "-Wunused-function"
#include "../../apps/lg-export/code/fmu/fmu_core.c"
static int span(unsigned int vr, int *at) {
    *at = (int)vr;
    return vr < NUMBERS;
}

TEST("the state of an FMU is saved as the bytes that x86-64 saves, and restored from them") {
    const instance in = {.exchange = 0};
    const memory state = {.mode = STEP, .time = 1.5, .values = {0.1, -2, 1e300}};
    memory back;
    unsigned char saved[sizeof(image)];
    lg_sha256 sha;
    write_image(&state, saved);
    assert_true(read_image(&in, saved, sizeof saved, &back));
    assert_memory_equal(&back, &state, sizeof state);
    lg_sha256_init(&sha);
    lg_sha256_add(&sha, saved, sizeof saved);
    assert_hash(&sha, "a state", "aa3221d905f6d3cbe82783b7923e0932346c5ab05c49cc51b0be81665386e6a2");
    saved[20] ^= 1;
    assert_false(read_image(&in, saved, sizeof saved, &back));
}
