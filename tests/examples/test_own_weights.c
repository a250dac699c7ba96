/* examples/own_weights: programs made of the weights in safetensors and numpy files compute the network. */
#include "support/io_test.h"
#include "test_support.h"

#include <math.h>
#include <sys/wait.h>
#include <unistd.h>

#include "liegrad/program.h"

int own_weights(int argc, char **argv);
#define main own_weights
#include "../../examples/own_weights/own_weights.c"
#undef main

/* y = [1, 2] tanh([[.5, -1], [2, .25]] x + [.1, -.2]) + .3; the weights are (out, in), or turned (in,
 * out). */
static const double weight1[4] = {0.5, -1, 2, 0.25}, turned1[4] = {0.5, 2, -1, 0.25}, bias1[2] = {0.1, -0.2},
                    weight2[2] = {1, 2}, bias2[1] = {0.3};

static double network_of(const double *x) {
    const double h1 = tanh(0.5 * x[0] - x[1] + 0.1), h2 = tanh(2 * x[0] + 0.25 * x[1] - 0.2);
    return h1 + 2 * h2 + 0.3;
}

static const char header[] =
    "{%s\"net.10.weight\":{\"dtype\":\"F64\",\"shape\":[%s],\"data_offsets\":[48,64]},"
    "\"net.10.bias\":{\"dtype\":\"F64\",\"shape\":[1],\"data_offsets\":[64,72]},"
    "\"net.2.bias\":{\"dtype\":\"F64\",\"shape\":[2],\"data_offsets\":[32,48]},"
    "\"net.2.weight\":{\"dtype\":\"F64\",\"shape\":[2,2],\"data_offsets\":[0,32]}}";

static const char *write_tensors(const char *text, const double *first) {
    static unsigned char bytes[2048];
    const uint64_t length = strlen(text);
    for (int i = 0; i < 8; i++) bytes[i] = (unsigned char)(length >> 8 * i & 255);
    memcpy(bytes + 8, text, length);
    memcpy(bytes + 8 + length, first, 32);
    memcpy(bytes + 40 + length, bias1, 16);
    memcpy(bytes + 56 + length, weight2, 16);
    memcpy(bytes + 72 + length, bias2, 8);
    const char *path = scratch_path("net.safetensors");
    write_bytes_to(path, bytes, 80 + length);
    return path;
}

static const char *write_array(const char *name, const char *shape, const double *numbers, size_t count) {
    static unsigned char bytes[1024];
    const char *text = test_text("{'descr': '<f8', 'fortran_order': False, 'shape': (%s), }\n", shape);
    const size_t length = strlen(text);
    memcpy(bytes, "\x93NUMPY\1\0", 8);
    bytes[8] = (unsigned char)length, bytes[9] = 0;
    memcpy(bytes + 10, text, length);
    memcpy(bytes + 10 + length, numbers, count * sizeof *numbers);
    const char *path = scratch_path(name);
    write_bytes_to(path, bytes, 10 + length + count * sizeof *numbers);
    return path;
}

/* Runs the example in a child, because it ends the process on errors, and returns its exit code. Its messages
 * go to a file. */
static int run_example(const char *const *arguments) {
    char *argv[12] = {(char *)(uintptr_t) "own_weights"};
    int argc = 1, status;
    for (; arguments[argc - 1] != NULL; argc++) argv[argc] = (char *)(uintptr_t)arguments[argc - 1];
    const pid_t child = fork();
    if (child == 0) {
        if (freopen(scratch_path("said"), "w", stderr) == NULL) _exit(9);
        exit(own_weights(argc, argv));
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}
#define RUN(...) run_example((const char *const[]){scratch_path("model.h5"), __VA_ARGS__, NULL})

static void check_program(void) {
    lg_program *program;
    lg_rng rng = test_rng(1, 0);
    assert_ok(lg_program_load(NULL, scratch_path("model.h5"), NULL, &program, NULL));
    assert_int_equal(unlink(scratch_path("model.h5")), 0);
    for (int i = 0; i < 20; i++) {
        const double x[2] = {lg_rng_normal(&rng), lg_rng_normal(&rng)};
        double y = 0;
        assert_ok(lg_program_eval(NULL, program, "value", 1, (const double *[]){x}, (double *[]){&y}, NULL));
        assert_close(y, network_of(x), 1e-13, 1e-14);
    }
    lg_program_destroy(program);
}

TEST("weights of safetensors files, (out, in) or as the file says (in, out), and of numpy files become "
     "programs") {
    static const char in_out[] = "\"__metadata__\":{\"layout\":\"weights are (in, out): y = x W + b\"},";
    const char *path = write_tensors(test_text(header, "", "1,2"), weight1);
    assert_int_equal(RUN(path, "net.2", "net.10"), 0);
    check_program();
    path = write_tensors(test_text(header, in_out, "2,1"), turned1);
    assert_int_equal(RUN(path, "net.2", "net.10"), 0);
    check_program();
    const char *w1 = write_array("W1.npy", "2, 2", weight1, 4), *b1 = write_array("b1.npy", "2,", bias1, 2),
               *w2 = write_array("W2.npy", "1, 2", weight2, 2), *b2 = write_array("b2.npy", "1,", bias2, 1);
    assert_int_equal(RUN(w1, b1, w2, b2), 0);
    check_program();
}

static void assert_said(int code, const char *words) {
    size_t size;
    unsigned char *said = read_bytes_of(scratch_path("said"), &size);
    assert_int_equal(code, 1);
    const char *text = test_text("%.*s", (int)size, (char *)said);
    if (strstr(text, words) == NULL) fail_msg("%s", text);
    assert_int_not_equal(access(scratch_path("model.h5"), F_OK), 0);
}

TEST("layers that are missing, in the wrong order or without their bias make no program") {
    const char *path = write_tensors(test_text(header, "", "1,2"), weight1);
    assert_said(RUN(path, "net.10", "net.2"), "shapes do not fit: (2, 1) and (2, 2) and (2), in net.2");
    assert_said(RUN(path, "net.2", "net.1"), "net.1: has no tensor .weight");
    assert_said(RUN(scratch_path("none.safetensors"), "net.2"), "none.safetensors");
    const char *w1 = write_array("W1.npy", "2, 2", weight1, 4), *b2 = write_array("b2.npy", "1,", bias2, 1);
    assert_said(RUN(w1, b2), test_text("shapes do not fit: (2, 2) and (2, 2) and (1), in %s", w1));
    const char *b1 = write_array("b1.npy", "2,", bias1, 2);
    assert_said(RUN(w1, b1, w1), "W1.npy: the file of the bias is missing");
    assert_int_equal(RUN(path), 2);
}
