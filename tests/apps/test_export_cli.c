/* lg-export (in LG_BIN_DIR) from outside: what it takes and refuses, names, folders that exist, damaged
 * files, interruption, a full disk, foreign words in comments; and that the self-test it writes can fail.
 * What the code of each kind of model computes is tested with the kinds. */
#include "export_support.h"

#include "liegrad/io.h"
#include "models/hamiltonian_internal.h"

static const char lg[] = "lg-export";
static cli result;
static size_t parameters; /* of the Hamiltonian below */
static double mass;       /* its gamma, 0: as drawn */

static const char *const suffixes[] = {".h", ".c", "_weights.c", "_test.c"};

/* ---- models ---- */

/* A small learned Hamiltonian; `size` multiplies the weights of its potential, `command` is its provenance.
 */
static void make_hamiltonian(const char *name, double size, const char *command) {
    char path[512];
    const uint32_t hidden[] = {4};
    lg_hamiltonian_file file = {.run = {.scheme = lg_scheme_find("cf4"), .substeps = 1, .dt = 0.1}};
    lg_rng rng;
    lg_rng_seed(&rng, 5, 6);
    file.run.training = (lg_training){.dtype = LG_F64,
                                      .epochs = 1,
                                      .batch = 1,
                                      .lr = 0.01,
                                      .lr_gamma = 0.1,
                                      .lr_step = 1,
                                      .adam_eps = 1e-8,
                                      .shards = 1};
    assert_ok(
        lg_hamiltonian_init(&file.run.model, &lg_hamiltonian_chain, 1, LG_POTENTIAL_MLP, hidden, 1, LG_TANH));
    file.parameters = lg_hamiltonian_parameters(&file.run.model);
    parameters = file.parameters;
    double *theta = calloc(parameters, sizeof *theta);
    assert_non_null(theta);
    lg_hamiltonian_initialise(&file.run.model, &rng, theta);
    theta[0] *= size;
    theta[1] = 10.0 + 11 * 0x1p-20; /* a number of single precision that takes nine digits */
    if (mass > 0) theta[lg_mlp_parameters(&file.run.model.net)] = mass;
    file.theta = theta;
    (void)snprintf(file.provenance.command, sizeof file.provenance.command, "%s", command);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_save_hamiltonian(NULL, path, &file, NULL, NULL));
    free(theta);
}

static void make_surrogate(const char *name) {
    char path[512];
    const lg_surrogate_options options = {.kind = LG_SURROGATE_DISCRETE,
                                          .architecture = LG_NET_MLP,
                                          .hidden = 3,
                                          .layers = 1,
                                          .activation = LG_TANH};
    lg_surrogate_file file = {.run = {.curves = 10}};
    lg_rng rng;
    lg_rng_seed(&rng, 5, 6);
    file.run.training = (lg_training){.dtype = LG_F64,
                                      .epochs = 1,
                                      .batch = 1,
                                      .lr = 0.01,
                                      .lr_gamma = 0.1,
                                      .lr_step = 1,
                                      .adam_eps = 1e-8,
                                      .shards = 1};
    assert_ok(lg_surrogate_init(&file.run.model, &options, 4, 3.3, 1.5, NULL));
    file.parameters = lg_surrogate_parameters(&file.run.model);
    file.theta = calloc(file.parameters, sizeof *file.theta);
    assert_non_null(file.theta);
    for (size_t i = 0; i < file.parameters; i++) file.theta[i] = lg_rng_normal(&rng);
    cli_path(name, path, sizeof path);
    assert_ok(lg_model_save_surrogate(NULL, path, &file, NULL, NULL));
    free(file.theta);
}

/* A file with nothing but its kind. */
static void make_kind(const char *name, const char *kind) {
    char path[512];
    lg_file_writer *writer;
    cli_path(name, path, sizeof path);
    assert_ok(lg_file_writer_create(NULL, path, kind, NULL, &writer, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
}

static size_t read_bytes(const char *name, unsigned char *out, size_t size) {
    char path[512];
    cli_path(name, path, sizeof path);
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t n = fread(out, 1, size, file);
    assert_int_equal(fclose(file), 0);
    assert_true(n < size);
    return n;
}

static void write_bytes(const char *name, const unsigned char *data, size_t bytes) {
    char path[512];
    cli_path(name, path, sizeof path);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
}

static int setup(void **state) {
    (void)state;
    if (export_begin() != 0) return -1;
    cli_write("empty.h5", "");
    cli_write("foreign.h5", "this is no HDF5 file, whatever its name says\n");
    cli_write("bad.yaml", "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3]\n");
    cli_write("kutta.yaml", "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\n");
    make_hamiltonian("pendulum.h5", 1, "lg-hamiltonian train");
    make_surrogate("beam.h5");
    make_kind("data.h5", "trajectories");
    make_kind("check.h5", "checkpoint");
    make_kind("odd.h5", "poem");
    make_kind("hollow.h5", "hamiltonian");
    make_kind("hollow-classifier.h5", "classifier");
    return 0;
}

/* ---- folders ---- */

static size_t entries(const char *name) {
    char path[512];
    size_t count = 0;
    cli_path(name, path, sizeof path);
    DIR *folder = opendir(path);
    for (struct dirent *entry; folder != NULL && (entry = readdir(folder)) != NULL;)
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) count++;
    if (folder != NULL) (void)closedir(folder);
    return count;
}

static bool has_all(const char *folder, const char *name) {
    char path[256];
    bool all = true;
    for (size_t i = 0; i < LG_COUNT(suffixes); i++) {
        (void)snprintf(path, sizeof path, "%s/%s%s", folder, name, suffixes[i]);
        all = all && cli_exists(path);
    }
    (void)snprintf(path, sizeof path, "%s/Makefile", folder);
    return all && cli_exists(path);
}

/* The folder's five files and `others`, and no temporary anywhere. */
static void expect_files(const char *folder, const char *name, size_t others) {
    if (!has_all(folder, name)) fail_msg("%s: not all files of %s", folder, name);
    assert_int_equal(entries(folder), 5 + others);
    assert_int_equal(cli_count_files("tmp"), 0);
}

/* ---- tests ---- */

static void test_help(void **state) {
    (void)state;
    cli_expect(lg, "--version", 0, "lg-export (liegrad) ", &result);
    cli_expect(lg, "--help", 0, "Usage: lg-export", &result);
    static const char *const words[] = {"--out=DIR",     "--name=NAME", "--dtype=NAME",
                                        "--scheme=NAME", "--golden=N",  "--seed=S",
                                        "--json",        "NAME_step",   "make test"};
    for (size_t i = 0; i < LG_COUNT(words); i++)
        if (strstr(result.out, words[i]) == NULL) fail_msg("--help does not say %s", words[i]);
}

static const cli_bad refused[] = {
    {"", 2, "missing argument"},
    {"pendulum.h5", 2, "--out is missing"},
    {"pendulum.h5 beam.h5 --out o", 2, "'beam.h5' is one argument too many"},
    {"pendulum.h5 --out o --bogus", 2, "--bogus"},
    {"pendulum.h5 --out o --dtype f16", 2, "'f16' is not one of f64, f32"},
    {"pendulum.h5 --out o --golden 0", 2, "--golden: '0'"},
    {"pendulum.h5 --out o --golden 1001", 2, "--golden: '1001'"},
    {"pendulum.h5 --out o --seed x", 2, "--seed: 'x'"},
    {"pendulum.h5 --out o --name 2x", 2, "begin with a letter"},
    {"pendulum.h5 --out o --name _x", 2, "begin with a letter"},
    {"pendulum.h5 --out o --name a-b", 2, "letters, digits and _ only"},
    {"pendulum.h5 --out o --name a/b", 2, "letters, digits and _ only"},
    {"pendulum.h5 --out o --name a__b", 2, "reserved"},
    {"pendulum.h5 --out o --name a_", 2, "reserved"},
    {"pendulum.h5 --out o --name int", 2, "taken by C or C++"},
    {"pendulum.h5 --out o --name class", 2, "taken by C or C++"},
    {"pendulum.h5 --out o --name xor_eq", 2, "taken by C or C++"},
    {"pendulum.h5 --out o --name math", 2, "taken by C or C++"},
    {"pendulum.h5 --out o --name Makefile", 2, "make takes"},
    {"pendulum.h5 --out o --name makeFILE", 2, "make takes"},
    {"pendulum.h5 --out o --name golden", 2, "words that begin so"},
    {"pendulum.h5 --out o --name NAME", 2, "words that begin so"},
    {"pendulum.h5 --out o --name a1234567890123456789012345678901234567890", 2, "1 to 40 letters"},
    {"pendulum.h5 --out o --name class --golden 2 --scheme nothing", 2, "--name: 'class'"},
    {"pendulum.h5 --out o --scheme nothing", 2, "cf4"},
    {"pendulum.h5 --out o --scheme rk4", 2, "rk4"},
    {"pendulum.h5 --out o --scheme stormer-verlet", 2, "stormer-verlet"},
    {"pendulum.h5 --out o --scheme slgi", 2, "slgi"},
    {"pendulum.h5 --out o --scheme variational", 2, "variational"},
    {"pendulum.h5 --out o --scheme missing.yaml", 3, "missing.yaml"},
    {"pendulum.h5 --out o --scheme bad.yaml", 3, "bad.yaml"},
    {"pendulum.h5 --out o --scheme ./pendulum.h5", 3, "pendulum.h5"},
    {"beam.h5 --out o --scheme cf4", 2, "only Hamiltonians"},
    {"hollow-classifier.h5 --out o --scheme cf4", 2, "only Hamiltonians"},
    {"missing.h5 --out o", 3, "missing.h5"},
    {"empty.h5 --out o", 3, "empty.h5"},
    {"foreign.h5 --out o", 3, "foreign.h5"},
    {"/dev/null --out o", 3, "/dev/null"},
    {". --out o", 3, "."},
    {"data.h5 --out o", 3, "trajectories"},
    {"check.h5 --out o", 3, "checkpoint"},
    {"odd.h5 --out o", 3, "'poem', expected hamiltonian, surrogate, detector, classifier or program"},
    {"hollow.h5 --out o", 3, "hollow.h5"},
    {"hollow-classifier.h5 --out o", 3, "hollow-classifier.h5"},
};

static void test_refused(void **state) {
    (void)state;
    cli_expect_refused(lg, refused, LG_COUNT(refused), &result);
    assert_false(cli_exists("o"));
}

static void test_names(void **state) {
    (void)state;
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
        char line[256];
        cli_link("pendulum.h5", rows[i][0]);
        (void)snprintf(line, sizeof line, "%s --out named", rows[i][0]);
        export_run(line);
        expect_files("named", rows[i][1], 0);
        if (i < 1) export_expect("make -C named test CFLAGS=-O0");
        export_expect("rm -r named");
    }
    export_run("pendulum.h5 --out named --name N1");
    expect_files("named", "N1", 0);
    assert_true(export_constant("named", "N1", "INPUTS") == 6);
    export_expect("rm -r named");
}

static void test_folders(void **state) {
    (void)state;
    export_run("pendulum.h5 --out new/");
    expect_files("new", "pendulum", 0);
    export_expect("mkdir -m 750 hollow");
    export_run("pendulum.h5 --out hollow");
    expect_files("hollow", "pendulum", 0);
    export_expect("test $(stat -c %a hollow) = 750");
    /* Into a folder with other files, twice: they stay, the five are new. */
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

/* Files that were not written for this name stay as they are, whichever of the five it is. */
static void test_files_of_others(void **state) {
    (void)state;
    static const char *const names[] = {"Makefile", "pendulum.h", "pendulum.c", "pendulum_weights.c",
                                        "pendulum_test.c"};
    static const char *const heads[] = {"", "all:", "/* lg-export: pendulums */", "# lg-export: pend",
                                        "/* lg-export: pendulum"};
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        char command[256], words[128];
        (void)snprintf(command, sizeof command,
                       "mkdir others && echo '%s' > others/%s && cp -r others before", heads[i], names[i]);
        (void)snprintf(words, sizeof words, "others/%s: exists and was not written by lg-export", names[i]);
        export_expect(command);
        cli_expect(lg, "pendulum.h5 --out others", 3, words, &result);
        export_expect("diff -r others before && rm -r others before");
    }
    export_run("pendulum.h5 --out one --name alpha");
    export_expect("cp -r one before");
    cli_expect(lg, "pendulum.h5 --out one --name beta", 3, "one/Makefile: exists", &result);
    cli_expect(lg, "pendulum.h5 --out one --name alph", 3, "one/Makefile: exists", &result);
    export_expect("diff -r one before && make -C one test CFLAGS=-O0 && rm -r one before");
}

static void test_bad_folders(void **state) {
    (void)state;
    static const cli_bad rows[] = {
        {"pendulum.h5 --out foreign.h5", 3, "foreign.h5: cannot be written: Not a directory"},
        {"pendulum.h5 --out nowhere/o", 3, "nowhere/o: cannot be written: No such file"},
        {"pendulum.h5 --out pendulum.h5/o", 3, "Not a directory"},
        {"pendulum.h5 --out /dev/null", 3, "/dev/null"},
        {"pendulum.h5 --out /proc/o", 3, "/proc/o"},
        {"pendulum.h5 --out dangling", 3, "dangling"},
        {"pendulum.h5 --out blocked", 3, "blocked/pendulum_test.c: exists and is not a regular file"}};
    cli_link("nothing/there", "dangling");
    export_expect("mkdir -p blocked/pendulum_test.c && echo '/* lg-export: pendulum */ old' > blocked/notes");
    cli_expect_refused(lg, rows, LG_COUNT(rows), &result);
    export_expect("test ! -e nowhere && test ! -e blocked/pendulum.c && grep -q old blocked/notes");
    assert_int_equal(entries("blocked"), 2);
    export_expect("grep -q 'no HDF5' foreign.h5 && rm -r blocked dangling");
    if (geteuid() == 0) return; /* who may write everywhere */
    export_expect("mkdir -m 555 fixed");
    cli_expect(lg, "pendulum.h5 --out fixed/o", 3, "Permission denied", &result);
    cli_expect(lg, "pendulum.h5 --out fixed", 0, "", &result); /* empty: replaced as a whole */
    export_expect("chmod 755 fixed && rm -r fixed");
}

/* Exit code 3 (or, where the damage did no harm, 0), no folder and no temporary. */
static void expect_harmless(const char *name, const char *what, size_t at) {
    char line[64];
    (void)snprintf(line, sizeof line, "%s --out o", name);
    cli_run_limited(lg, line, 0, &result);
    if (result.code != 3 && result.code != 0)
        fail_msg("%s at %zu: exit code %d\n%s", what, at, result.code, result.err);
    if (result.code == 3 && strncmp(result.err, "lg-export: ", 11) != 0)
        fail_msg("%s at %zu: no sentence: %s", what, at, result.err);
    if (cli_exists("o") != (result.code == 0)) fail_msg("%s at %zu: the folder is there or is not", what, at);
    assert_int_equal(cli_count_files("tmp"), 0);
    if (result.code == 0) export_expect("rm -r o");
}

static void test_damaged(void **state) {
    (void)state;
    enum { SIZE = 1 << 20, CUTS = 16, FLIPS = 24 };
    static unsigned char data[SIZE];
    const size_t bytes = read_bytes("pendulum.h5", data, SIZE);
    lg_rng rng;
    lg_rng_seed(&rng, 1, 2);
    for (size_t i = 0; i < CUTS; i++) {
        const size_t kept = i < 4 ? i : bytes * i / CUTS;
        write_bytes("cut.h5", data, kept);
        expect_harmless("cut.h5", "cut", kept);
        assert_int_equal(result.code, 3);
    }
    for (size_t i = 0; i < FLIPS; i++) {
        const size_t at = (size_t)lg_rng_below(&rng, i % 2 == 0 ? bytes : 2048);
        const unsigned char old = data[at];
        data[at] ^= (unsigned char)(1u << (i % 8));
        write_bytes("cut.h5", data, bytes);
        expect_harmless("cut.h5", "flipped", at);
        data[at] = old;
    }
}

/* Killed or interrupted at any moment, the folder is whole or not there. */
static void test_stopped(void **state) {
    (void)state;
    for (int i = 0; i < 16; i++) {
        const struct timespec pause = {0, 2000000 * (i / 2)};
        const bool killed = i % 2 == 0;
        const cli_child child = cli_start(lg, "pendulum.h5 --out o", 0);
        (void)nanosleep(&pause, NULL);
        (void)kill(child.pid, killed ? SIGKILL : SIGINT);
        cli_finish(child, &result);
        if (cli_exists("o")) expect_files("o", "pendulum", 0);
        if (!killed && result.code == 130) assert_false(cli_exists("o"));
        if (!killed) assert_int_equal(cli_count_files("tmp"), 0);
        export_expect("rm -rf o o.tmp*");
    }
}

static void test_full_disk(void **state) {
    (void)state;
    static const rlim_t limits[] = {1, 500, 2000, 4000, 8000};
    export_expect("mkdir kept && printf '/* lg-export: pendulum */\\nold\\n' > kept/pendulum.c");
    for (size_t i = 0; i < LG_COUNT(limits); i++) {
        cli_expect_limited(lg, "pendulum.h5 --out o", limits[i], 3, "o: cannot be written: File too large",
                           &result);
        assert_false(cli_exists("o"));
        cli_expect_limited(lg, "pendulum.h5 --out kept", limits[i], 3, "File too large", &result);
        assert_int_equal(entries("kept"), 1);
        assert_int_equal(cli_count_files("tmp"), 0);
    }
    export_expect("grep -q old kept/pendulum.c && rm -r kept");
}

static void test_json(void **state) {
    (void)state;
    cli_expect(lg, "pendulum.h5 --out o --dtype f32 --scheme rkmk4 --golden 3 --json", 0, "", &result);
    assert_true(json_is_object(result.out));
    static const char *const words[] = {
        "\"name\": \"pendulum\"", "\"kind\": \"hamiltonian\"", "\"dtype\": \"f32\"", "\"scheme\": \"rkmk4\"",
        ("\"files\": [\"pendulum.h\", \"pendulum.c\", \"pendulum_weights.c\", "
         "\"pendulum_test.c\", \"Makefile\"]")};
    for (size_t i = 0; i < LG_COUNT(words); i++)
        if (strstr(result.out, words[i]) == NULL) fail_msg("no %s in %s", words[i], result.out);
    assert_close(json_number(result.out, "parameters"), (double)parameters, 0, 0);
    /* One of them is the shift of the mass, which is stored as part of its inverse. */
    assert_true(json_number(result.out, "weights_bytes") >= (double)(4 * (parameters - 1)));
    assert_close(json_number(result.out, "work_size"), export_constant("o", "pendulum", "WORK_SIZE"), 0, 0);
    assert_close(json_number(result.out, "stack_size"), export_constant("o", "pendulum", "STACK_SIZE"), 0, 0);
    assert_close(json_number(result.out, "depth"), export_constant("o", "pendulum", "DEPTH"), 0, 0);
    assert_close(json_number(result.out, "tolerance"), export_constant("o", "pendulum", "TOLERANCE"), 0, 0);
    assert_close(json_number(result.out, "tolerance"), 20 * 0x1p-23 * json_number(result.out, "depth"), 1e-15,
                 0);
    export_expect("rm -r o");
    cli_expect(lg, "beam.h5 --out o --json", 0, "\"kind\": \"surrogate\"", &result);
    assert_true(json_is_object(result.out));
    assert_non_null(strstr(result.out, "\"scheme\": null"));
    export_expect("rm -r o");
}

/* Decimals of NAME_weights.c and the hexadecimal comment below them are the same numbers; returns how many.
 */
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

static void test_weights(void **state) {
    (void)state;
    cli_expect(lg, "pendulum.h5 --out o --json", 0, "", &result);
    const double bytes = json_number(result.out, "weights_bytes");
    assert_close((double)(8 * same_numbers("o/pendulum_weights.c", false)), bytes, 0, 0);
    export_run("pendulum.h5 --out o --dtype f32");
    assert_close((double)(8 * same_numbers("o/pendulum_weights.c", true)), bytes, 0, 0);
    export_expect("grep -q $(sha256sum pendulum.h5 | cut -c 1-64) o/pendulum.h && rm -r o");
}

/* The same model gives the same bytes; another seed another self-test. */
static void test_reproducible(void **state) {
    (void)state;
    export_run("pendulum.h5 --out one --scheme kutta.yaml");
    export_run("pendulum.h5 --out two --scheme kutta.yaml");
    export_expect("diff -r one two");
    export_run("pendulum.h5 --out two --scheme kutta.yaml --seed 2");
    export_expect("cmp one/pendulum.c two/pendulum.c && cmp one/pendulum_weights.c two/pendulum_weights.c && "
                  "! cmp one/pendulum_test.c two/pendulum_test.c");
    export_expect("rm -r one two");
}

/* Words of other people in comments: neither ends nor begins one, no warning, ASCII. */
static void test_comments(void **state) {
    (void)state;
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
    cli_expect(lg, "pendulum.h5 --out o", 0, "", &result);
    char text[65536];
    (void)cli_read("o/pendulum.h", text, sizeof text);
    char *line = text;
    for (char *end; (end = strchr(line, '\n')) != NULL; line = end + 1)
        if (strncmp(line, " * ", 3) == 0 && end - line > 112)
            fail_msg("a long line: %.*s", (int)(end - line), line);
    export_expect("rm -r o");
}

/* What single precision cannot hold is not written in it, and what is not finite, or so large that its norm
 * is not, in no precision. */
static void test_unfit(void **state) {
    (void)state;
    make_hamiltonian("large.h5", 1e60, "");
    cli_expect(lg, "large.h5 --out o --dtype f32", 3, "large.h5", &result);
    assert_false(cli_exists("o"));
    export_run("large.h5 --out o");
    export_expect("make -C o test CFLAGS=-O1 && rm -r o");
    for (int i = 0; i < 8; i++) {
        static const double size[] = {1e300, 1e-300, 1e200, 1e155};
        mass = size[i / 2];
        make_hamiltonian("heavy.h5", 1, "");
        mass = 0;
        cli_run_limited(lg, i % 2 == 0 ? "heavy.h5 --out o" : "heavy.h5 --out o --dtype f32", 0, &result);
        if (result.code != 0 && result.code != 3)
            fail_msg("gamma %g: exit code %d\n%s", size[i / 2], result.code, result.err);
        if (i < 2) assert_int_equal(result.code, 3);
        if (result.code == 3) assert_non_null(strstr(result.err, "heavy.h5"));
        if (result.code == 0) export_expect("make -C o test CFLAGS=-O1 && rm -r o");
        assert_false(cli_exists("o"));
    }
}

/* Units are those of the file, and words for a file without. */
static void test_units(void **state) {
    (void)state;
    export_run("pendulum.h5 --out o");
    export_expect("grep -q '^ \\* units  *of the inputs: q: 1, p: kg m^2/s$' o/pendulum.h && grep -q '^ \\*  "
                  "*of the outputs: J$' o/pendulum.h && rm -r o");
}

/* A self-test passes, and fails for another weight, a NaN, a missing assignment, a result that depends on the
 * contents of work. */
static void test_self_test_fails(void **state) {
    (void)state;
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_help),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_names),
        cmocka_unit_test(test_folders),
        cmocka_unit_test(test_files_of_others),
        cmocka_unit_test(test_units),
        cmocka_unit_test(test_bad_folders),
        cmocka_unit_test(test_damaged),
        cmocka_unit_test(test_stopped),
        cmocka_unit_test(test_full_disk),
        cmocka_unit_test(test_json),
        cmocka_unit_test(test_weights),
        cmocka_unit_test(test_reproducible),
        cmocka_unit_test(test_comments),
        cmocka_unit_test(test_unfit),
        cmocka_unit_test(test_self_test_fails),
    };
    return cmocka_run_group_tests(tests, setup, export_end);
}
