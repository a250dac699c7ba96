/* Runs lg-export (in LG_BIN_DIR): names, existing folders, damaged files, interruption, a full disk, texts of
 * users in comments; and checks that the written self-test can fail. What it refuses is in test_refused. What
 * the code of each kind of model computes is tested with that kind.
 * ctest-labels: apps/lg-export */
#include "export_support.h"

#include "liegrad/hamiltonian.h"
#include "liegrad/integrators.h"
#include "hamiltonian/internal.h"

static const char lg[] = "lg-export";
static size_t parameters; /* of the Hamiltonian below */
static double mass;       /* the model's gamma; 0: as it was drawn */

static const char *const suffixes[] = {".h", ".c", "_weights.c", "_test.c"};

/* ---- models ---- */

#define TRAINING                                                                                             \
    {                                                                                                        \
        .dtype = LG_F64, .epochs = 1, .batch = 1, .lr = 0.01, .lr_gamma = 0.1, .lr_step = 1,                 \
        .adam_eps = 1e-8, .shards = 1                                                                        \
    }

/* A small learned Hamiltonian. `size` multiplies the first weight of its potential; `command` is the command
 * line that it stores. */
static void make_hamiltonian(const char *name, double size, const char *command) {
    const uint32_t hidden[] = {4};
    lg_hamiltonian_file file = {
        .run = {.scheme = lg_scheme_find("cf4"), .substeps = 1, .dt = 0.1, .training = TRAINING}};
    lg_rng rng = test_rng(5, 6);
    assert_ok(
        lg_hamiltonian_init(&file.run.model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    file.parameters = lg_hamiltonian_parameters(&file.run.model);
    parameters = file.parameters;
    double *theta = TEST_ARRAY(double, parameters);
    lg_hamiltonian_initialise(&file.run.model, &rng, theta);
    theta[0] *= size;
    theta[1] = 10.0 + 11 * 0x1p-20; /* a float that needs nine digits */
    if (mass > 0) theta[lg_mlp_parameters(&file.run.model.net)] = mass;
    file.theta = theta;
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "%s", command);
    assert_ok(lg_recipe_save(NULL, cli_at(name), &lg_recipe_hamiltonian, &file, NULL, NULL));
}

static int setup(void **state) {
    if (export_begin(state) != 0) return -1;
    cli_write("foreign.h5", "this is no HDF5 file, whatever its name says\n");
    cli_write("kutta.yaml", "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\n");
    make_hamiltonian("pendulum.h5", 1, "lg-hamiltonian train");
    return 0;
}

/* ---- output folders ---- */

static size_t entries(const char *name) {
    size_t count = 0;
    DIR *folder = opendir(cli_at(name));
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;)
        if (!cli_is_dots(entry->d_name)) count++;
    if (folder != NULL) (void)closedir(folder);
    return count;
}

static bool has_all(const char *folder, const char *name) {
    bool all = true;
    for (size_t i = 0; i < LG_COUNT(suffixes); i++) {
        all = all && cli_exists(test_text("%s/%s%s", folder, name, suffixes[i]));
    }
    return all && cli_exists(test_text("%s/Makefile", folder));
}

/* The folder must have the model's five files and `others` more, and no temporary file may exist. */
static void expect_files(const char *folder, const char *name, size_t others) {
    if (!has_all(folder, name)) fail_msg("%s: not all files of %s", folder, name);
    assert_int_equal(entries(folder), 5 + others);
    assert_int_equal(cli_count_files("tmp"), 0);
}

/* ---- tests ---- */

TEST("the model's name is made from the file's name, or given") {
    static const char *const rows[][2] = {
        {"2024.h5", "model_2024"},
        {"spherical-pendulum.v2.h5", "spherical_pendulum_v2"},
        {"int.h5", "model_int"},
        {"__.h5", "model"},
        {".h5", "h5"},
        {"\xc3\xa9t\xc3\xa9.h5", "t"},
        {"math.h5", "model_math"},
        {"golden.h5", "model_golden"},
        {"NAME.h5", "model_NAME"},
        {"a_very_long_name_that_is_cut_somewhere_and_still_is_one.h5", "a_very_long_name_that_is_cut_som"},
        {"no-ending", "no_ending"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_link("pendulum.h5", rows[i][0]);
        export_run(test_text("%s --out named", rows[i][0]));
        expect_files("named", rows[i][1], 0);
        if (i < 1) export_expect("make -C named test CFLAGS=-O0");
        export_expect("rm -r named");
    }
    export_run("pendulum.h5 --out named --name N1");
    expect_files("named", "N1", 0);
    assert_true(export_constant("named", "N1", "INPUTS") == 6);
    export_expect("rm -r named");
}

TEST("the output folder is made, replaced when it is empty, or gets the five files beside other files") {
    export_run("pendulum.h5 --out new/");
    expect_files("new", "pendulum", 0);
    export_expect("mkdir -m 750 hollow");
    export_run("pendulum.h5 --out hollow");
    expect_files("hollow", "pendulum", 0);
    export_expect("test $(stat -c %a hollow) = 750");
    /* A folder with other files, twice: the other files stay, the five are written again. */
    export_expect(
        "mkdir mine && cp pendulum.h5 mine && cp new/pendulum.c mine && echo old >> mine/pendulum.c "
        "&& echo mine > mine/notes");
    export_run("mine/pendulum.h5 --out mine");
    expect_files("mine", "pendulum", 2);
    export_expect(
        "cmp mine/pendulum.c new/pendulum.c && cmp mine/pendulum.h5 pendulum.h5 && grep -q mine mine/notes");
    export_run("pendulum.h5 --out mine/ --dtype f32");
    expect_files("mine", "pendulum", 2);
    export_expect("grep -q 'typedef float' mine/pendulum.h");
    export_expect("mkdir far && ln -s far near");
    export_run("pendulum.h5 --out near");
    expect_files("far", "pendulum", 0);
    export_expect("test -L near && rm -r near far mine hollow new");
}

TEST("files that were not written for this name are not overwritten, whichever of the five it is") {
    static const char *const names[] = {"Makefile", "pendulum.h", "pendulum.c", "pendulum_weights.c",
                                        "pendulum_test.c"};
    static const char *const heads[] = {"", "all:", "/* lg-export: pendulums */", "# lg-export: pend",
                                        "/* lg-export: pendulum"};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        char command[256];
        (void)snprintf(command, sizeof command,
                       "mkdir others && echo '%s' > others/%s && cp -r others before", heads[i], names[i]);
        const char *words = test_text("others/%s: exists and was not written by lg-export", names[i]);
        export_expect(command);
        cli_expect(lg, "pendulum.h5 --out others", 3, words);
        export_expect("diff -r others before && rm -r others before");
    }
    export_run("pendulum.h5 --out one --name alpha");
    export_expect("cp -r one before");
    cli_expect(lg, "pendulum.h5 --out one --name beta", 3, "one/Makefile: exists");
    cli_expect(lg, "pendulum.h5 --out one --name alph", 3, "one/Makefile: exists");
    export_expect("diff -r one before && make -C one test CFLAGS=-O0 && rm -r one before");
}

TEST("a folder with a non-file in the place of one of the files stays unchanged") {
    export_expect("mkdir -p blocked/pendulum_test.c && echo '/* lg-export: pendulum */ old' > blocked/notes");
    cli_expect(lg, "pendulum.h5 --out blocked", 3,
               "blocked/pendulum_test.c: exists and is not a regular file");
    export_expect("test ! -e blocked/pendulum.c && grep -q old blocked/notes");
    assert_int_equal(entries("blocked"), 2);
    export_expect("rm -r blocked");
    if (geteuid() == 0) return; /* root can write everywhere */
    export_expect("mkdir -m 555 fixed");
    cli_expect(lg, "pendulum.h5 --out fixed/o", 3, "Permission denied");
    export_run("pendulum.h5 --out fixed"); /* an empty folder is replaced as a whole */
    export_expect("chmod 755 fixed && rm -r fixed");
}

/* The exit code must be 3, or 0 if the damage had no effect; with 3 no folder and no temporary file may
 * exist. */
static void expect_harmless(const char *name, const char *what, size_t at) {
    cli_run_limited(lg, test_text("%s --out o", name), 0);
    if (result.code != 3 && result.code != 0)
        fail_msg("%s at %zu: exit code %d\n%s", what, at, result.code, result.err);
    if (result.code == 3 && strncmp(result.err, "lg-export: ", 11) != 0)
        fail_msg("%s at %zu: no sentence: %s", what, at, result.err);
    if (cli_exists("o") != (result.code == 0)) fail_msg("%s at %zu: the folder is there or is not", what, at);
    assert_int_equal(cli_count_files("tmp"), 0);
    if (result.code == 0) export_expect("rm -r o");
}

static void write_bytes(const char *name, const char *data, size_t bytes) {
    FILE *file = fopen(cli_at(name), "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
}

TEST("a damaged model is refused, or the damage has no effect") {
    enum { SIZE = 1 << 20, CUTS = 16, FLIPS = 24 };
    static char data[SIZE];
    const size_t bytes = cli_read("pendulum.h5", data, SIZE);
    assert_true(bytes < SIZE - 1);
    lg_rng rng = test_rng(1, 2);
    for (size_t i = 0; i < CUTS; i++) {
        const size_t kept = i < 4 ? i : bytes * i / CUTS;
        write_bytes("cut.h5", data, kept);
        expect_harmless("cut.h5", "cut", kept);
        assert_int_equal(result.code, 3);
    }
    for (size_t i = 0; i < FLIPS; i++) {
        const size_t at = (size_t)lg_rng_below(&rng, i % 2 == 0 ? bytes : 2048);
        const char old = data[at];
        data[at] = (char)(data[at] ^ (1 << (i % 8)));
        write_bytes("cut.h5", data, bytes);
        expect_harmless("cut.h5", "flipped", at);
        data[at] = old;
    }
}

TEST("after a kill or an interrupt at any time, the folder is complete or does not exist") {
    for (int i = 0; i < 16; i++) {
        const struct timespec pause = {0, 2000000 * (i / 2)};
        const bool killed = i % 2 == 0;
        const cli_child child = cli_start(lg, "pendulum.h5 --out o", 0);
        (void)nanosleep(&pause, NULL);
        (void)kill(child.pid, killed ? SIGKILL : SIGINT);
        cli_finish(child);
        if (cli_exists("o")) expect_files("o", "pendulum", 0);
        if (!killed && result.code == 130) assert_false(cli_exists("o"));
        if (!killed) assert_int_equal(cli_count_files("tmp"), 0);
        export_expect("rm -rf o .o.*");
    }
}

TEST("a full disk is reported, and existing files stay") {
    static const rlim_t limits[] = {1, 500, 2000, 4000, 8000};
    export_expect("mkdir kept && printf '/* lg-export: pendulum */\\nold\\n' > kept/pendulum.c");
    for (size_t i = 0; i < LG_COUNT(limits); i++) {
        cli_expect_limited(lg, "pendulum.h5 --out o", limits[i], 3,
                           i == 0 ? ".o.liegrad-lock: File too large"
                                  : "o: cannot be written: File too large");
        assert_false(cli_exists("o"));
        cli_expect_limited(lg, "pendulum.h5 --out kept", limits[i], 3, "File too large");
        assert_int_equal(entries("kept"), 1);
        assert_int_equal(cli_count_files("tmp"), 0);
    }
    export_expect("grep -q old kept/pendulum.c && rm -r kept");
}

TEST("--json prints what was written") {
    static const char *const constants[][2] = {{"work_size", "WORK_SIZE"},
                                               {"stack_size", "STACK_SIZE"},
                                               {"depth", "DEPTH"},
                                               {"tolerance", "TOLERANCE"}};
    cli_json(lg, "pendulum.h5 --out o --dtype f32 --scheme rkmk4 --golden 3",
             "name \"pendulum\", kind \"hamiltonian\", dtype \"f32\", scheme \"rkmk4\"");
    assert_says(result.out, "\"files\": [\"pendulum.h\", \"pendulum.c\", \"pendulum_weights.c\", "
                            "\"pendulum_test.c\", \"Makefile\"]");
    assert_close(json_number(result.out, "parameters"), (double)parameters, 0, 0);
    /* One parameter, the shift of the mass, is stored as part of the mass's inverse. */
    assert_true(json_number(result.out, "weights_bytes") >= (double)(4 * (parameters - 1)));
    for (size_t i = 0; i < LG_COUNT(constants); i++)
        assert_close(json_number(result.out, constants[i][0]),
                     export_constant("o", "pendulum", constants[i][1]), 0, 0);
    assert_close(json_number(result.out, "tolerance"), 20 * 0x1p-23 * json_number(result.out, "depth"), 1e-15,
                 0);
    export_expect("rm -r o");
}

/* Fails unless the decimal numbers of NAME_weights.c equal the hexadecimal numbers in the comment below them.
 * Returns their number. */
static size_t same_numbers(const char *name, bool single) {
    static char text[65536];
    size_t count = 0;
    (void)cli_read(name, text, sizeof text);
    char *lines[2] = {NULL, NULL};
    for (char *save = NULL, *line = strtok_r(text, "\n", &save); line != NULL;
         line = strtok_r(NULL, "\n", &save)) {
        lines[0] = lines[1];
        lines[1] = line;
        if (lines[0] == NULL || strncmp(line, "    /* ", 7) != 0 || strstr(line, "0x") == NULL) continue;
        char *decimal = lines[0], *hex = line + 7, *end;
        for (; *hex != '*'; hex += strspn(hex, " "), count++) {
            const double exact = strtod(hex, &hex);
            const double shown = single ? (double)strtof(decimal, &end) : strtod(decimal, &end);
            assert_true(end > decimal && shown == exact);
            if (strncmp(end, single ? "f," : ",", single ? 2 : 1) != 0) fail_msg("no end: %s", end);
            decimal = strchr(end, ',') + 1;
        }
        assert_int_equal(*decimal, '\0');
    }
    return count;
}

TEST("the weights' decimal numbers equal the hexadecimal numbers in the comment below them") {
    cli_expect(lg, "pendulum.h5 --out o --json", 0, "");
    const double bytes = json_number(result.out, "weights_bytes");
    assert_close((double)(8 * same_numbers("o/pendulum_weights.c", false)), bytes, 0, 0);
    export_run("pendulum.h5 --out o --dtype f32");
    assert_close((double)(8 * same_numbers("o/pendulum_weights.c", true)), bytes, 0, 0);
    export_expect("grep -q $(sha256sum pendulum.h5 | cut -c 1-64) o/pendulum.h && rm -r o");
}

TEST("the same model gives the same bytes; another seed gives another self-test") {
    export_run("pendulum.h5 --out one --scheme kutta.yaml");
    export_run("pendulum.h5 --out two --scheme kutta.yaml");
    export_expect("diff -r one two");
    export_run("pendulum.h5 --out two --scheme kutta.yaml --seed 2");
    export_expect("cmp one/pendulum.c two/pendulum.c && cmp one/pendulum_weights.c two/pendulum_weights.c && "
                  "! cmp one/pendulum_test.c two/pendulum_test.c");
    export_expect("rm -r one two");
}

TEST("a user's texts in comments neither end nor begin a comment, cause no warning and become ASCII") {
    static const export_way ways[] = {{"gcc", "-O0 -Wcomment -Wtrigraphs"},
                                      {"clang", "-O0 -Wcomment -Wtrigraphs"},
                                      {"g++", "-O0 -Wcomment -Wtrigraphs"},
                                      {"clang++", "-O0 -Wcomment -Wtrigraphs"}};
    make_hamiltonian("evil*_?"
                     "?_model.h5",
                     1,
                     "lg train */ int x = 1/0; /* /*/ **/ ?"
                     "?/\n?"
                     "?' a\\\nb\\ // \xc2\xb5 \xe2\x80\xae \xff "
                     "\x01\x1b[31m \\");
    export_run("evil*_?"
               "?_model.h5 --out evil --name evil");
    export_check_each("evil", "evil", ways, LG_COUNT(ways));
    export_expect("! LC_ALL=C grep -n '[^ -~\t]' evil/evil.h");
    export_expect("grep -q 'trained by' evil/evil.h && grep -q 'U+00B5' evil/evil.h && rm -r evil");
    cli_expect(lg, "pendulum.h5 --out o", 0, "");
    char text[65536];
    (void)cli_read("o/pendulum.h", text, sizeof text);
    char *line = text;
    for (char *end; (end = strchr(line, '\n')) != NULL; line = end + 1)
        if (strncmp(line, " * ", 3) == 0 && end - line > 112)
            fail_msg("a long line: %.*s", (int)(end - line), line);
    export_expect("rm -r o");
}

/* Refused: in single precision, numbers that a float cannot hold; in both precisions, numbers that are not
 * finite or so large that their norm is not. */
TEST("numbers that the precision cannot hold are refused") {
    make_hamiltonian("large.h5", 1e60, "");
    cli_expect(lg, "large.h5 --out o --dtype f32", 3, "large.h5");
    assert_false(cli_exists("o"));
    export_run("large.h5 --out o");
    export_expect("make -C o test CFLAGS=-O1 && rm -r o");
    for (int i = 0; i < 8; i++) {
        static const double size[] = {1e300, 1e-300, 1e200, 1e155};
        mass = size[i / 2];
        make_hamiltonian("heavy.h5", 1, "");
        mass = 0;
        cli_run_limited(lg, i % 2 == 0 ? "heavy.h5 --out o" : "heavy.h5 --out o --dtype f32", 0);
        if (result.code != 0 && result.code != 3)
            fail_msg("gamma %g: exit code %d\n%s", size[i / 2], result.code, result.err);
        if (i < 2) assert_int_equal(result.code, 3);
        if (result.code == 3) assert_non_null(strstr(result.err, "heavy.h5"));
        if (result.code == 0) export_expect("make -C o test CFLAGS=-O1 && rm -r o");
        assert_false(cli_exists("o"));
    }
}

/* Exports to targets that write C (c, package) and to targets that write only numbers (onnx, safetensors). */
TEST("numbers too small for single precision cause a warning in every format, other numbers do not") {
    static const char *const targets[] = {"c", "package", "onnx", "safetensors"};
    make_hamiltonian("small.h5", 1e-60, "");
    for (size_t i = 0; i < LG_COUNT(targets); i++) {
        for (int k = 0; k < 3; k++) {
            const char *command =
                test_text("%s --json --out o --target %s --dtype %s", k < 2 ? "small.h5" : "pendulum.h5",
                          targets[i], k != 1 ? "f32" : "f64");
            cli_expect(lg, command, 0, "");
            const bool told = strstr(result.err, "lose digits or become 0 in single precision") != NULL;
            if (told != (k == 0) || told != (strstr(result.out, "lose digits or become 0") != NULL))
                fail_msg("%s: told %d\n%s%s", command, told, result.err, result.out);
            export_expect("rm -r o");
        }
    }
}

TEST("the header's units are those of the model file") {
    export_run("pendulum.h5 --out o");
    export_expect("grep -q '^ \\* units  *of the inputs: q: 1, p: kg m^2/s$' o/pendulum.h && grep -q '^ \\*  "
                  "*of the outputs: J$' o/pendulum.h && rm -r o");
}

/* A self-test must pass, and fail for a changed weight, a NaN, a missing assignment, and a result that
 * depends on the contents of work. */
TEST("a self-test fails for a changed weight, a NaN, a missing assignment, dependence on work, and a "
     "zero tolerance") {
    static char out[EXPORT_TEXT];
    static const struct {
        const char *edit, *words;
    } plants[] = {
        {"sed -i '0,/^    -*[0-9]/s//    1.5 + &/' pendulum_weights.c", "WRONG"},
        {"sed -i '0,/^    -*[0-9]/s//    NAN + &/; s/#include/#include <math.h>\\n&/' pendulum_weights.c",
         "WRONG"},
        {"sed -i 's/^void pendulum_grad(.*/&\\n    y1[0] = work[0];\\n    return;/' pendulum.c", "WRONG"},
        {"sed -i 's/^void pendulum_eval(/static void inner_eval(/' pendulum.c && echo 'void "
         "pendulum_eval(const real "
         "*x, real *y, real *work) { const int odd = work[0] > 1; inner_eval(x, y, work); if (odd) y[0] *= 1 "
         "+ "
         "1e-15; }' >> pendulum.c",
         "DEPENDS ON THE CONTENTS OF WORK"},
        {"sed -i 's/^\\(#define pendulum_TOLERANCE\\).*/\\1 1e-30/' pendulum.h", "WRONG"},
    };
    export_run("pendulum.h5 --out good");
    if (export_shell("make -C good test CFLAGS=-O1", out) != 0) fail_msg("%s", out);
    assert_non_null(strstr(out, "value"));
    assert_non_null(strstr(out, "gradient"));
    assert_non_null(strstr(out, "field and step"));
    for (size_t i = 0; i < LG_COUNT(plants); i++) {
        char command[512];
        (void)snprintf(
            command, sizeof command,
            "rm -rf bad && cp -r good bad && cd bad && make clean && %s && ! diff -r . ../good && make "
            "pendulum_test CFLAGS=-O1",
            plants[i].edit);
        export_expect(command);
        if (export_shell("bad/pendulum_test", out) != 1 || strstr(out, plants[i].words) == NULL)
            fail_msg("%s: not caught\n%s", plants[i].edit, out);
    }
    export_expect("rm -r good bad");
}

TEST_GROUP(setup, export_end)
