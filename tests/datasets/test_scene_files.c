/* Scenes and grids: every key, the matrix of bad input, the scenes that come with the program. */
#include <sys/stat.h>

#include "io_test.h"

static const char good_scene[] = "# a comment\n"                  /* 1 */
                                 "system: pendulum-chain\n"       /* 2 */
                                 "form: hamiltonian\n"            /* 3 */
                                 "gravity: 9.81\n"                /* 4 */
                                 "masses: [1, 1.3]\n"             /* 5 */
                                 "lengths: [1, 0.8]\n"            /* 6 */
                                 "initial:\n"                     /* 7 */
                                 "  q: [[0.6, 0, 0.8],\n"         /* 8 */
                                 "      [0, 1, 0]]\n"             /* 9 */
                                 "  p: [[0, 2, 0], [1, 0, -3]]\n" /* 10 */
                                 "t_end: 3\n";                    /* 11 */

static const char json_scene[] = "{\"system\": \"pendulum-chain\", \"form\": \"lagrangian\",\n"
                                 " \"gravity\": -9.81e0, \"links\": 1,\n"
                                 " \"initial\": {\"q\": [[0, 0, -1]], \"omega\": [[1, 2, 0]]},\n"
                                 " \"t_end\": 2.5}\n";

static const char good_grid[] = "scene: scene.yaml\n"                  /* 1 */
                                "integrators: [cf4, rk4]\n"            /* 2 */
                                "N: [50, 500]\n"                       /* 3 */
                                "M: 5\n"                               /* 4 */
                                "eps: [0, 1e-3, 0.1]\n"                /* 5 */
                                "penalty: [0, 1e-3]\n"                 /* 6 */
                                "substeps: [1, 2]\n"                   /* 7 */
                                "repeats: 5\n"                         /* 8 */
                                "hidden: [30, 30]\n"                   /* 9 */
                                "dtype: f32\n"                         /* 10 */
                                "test: {trajectories: 7, points: 9}\n" /* 11 */
                                "seed: 18446744073709551615\n"         /* 12 */
                                "t_end: 0.1\n";                        /* 13 */

static lg_status read_scene(const lg_context *context, const char *path, const lg_read_options *options,
                            lg_error *error) {
    (void)options;
    lg_scene scene;
    return lg_scene_read(context, path, &scene, error);
}

static lg_status read_grid(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    (void)options;
    lg_grid grid;
    return lg_grid_read(context, path, &grid, error);
}

static const char *file_of(const char *name, const char *text) {
    const char *path = scratch_path(name);
    write_text_to(path, text);
    return path;
}

/* `text` with `from` replaced by `to`, which must be there. */
static const char *changed(const char *name, const char *text, const char *from, const char *to) {
    char out[4096];
    const char *at = strstr(text, from);
    assert_non_null(at);
    (void)snprintf(out, sizeof out, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from));
    return file_of(name, out);
}

static void every_key(void **state) {
    (void)state;
    lg_scene scene;
    assert_ok(lg_scene_read(NULL, file_of("scene.yaml", good_scene), &scene, NULL));
    assert_string_equal(scene.system, "pendulum-chain");
    assert_int_equal(scene.family, LG_HAMILTONIAN_CHAIN);
    assert_int_equal(scene.form, LG_SCENE_HAMILTONIAN);
    assert_int_equal(scene.links, 2);
    assert_int_equal(scene.state_size, 12);
    assert_close(scene.gravity, 9.81, 0, 0);
    assert_close(scene.masses[1], 1.3, 0, 0);
    assert_close(scene.lengths[1], 0.8, 0, 0);
    const double state12[12] = {0.6, 0, 0.8, 0, 2, 0, 0, 1, 0, 1, 0, -3};
    for (int i = 0; i < 12; i++) assert_close(scene.state[i], state12[i], 0, 0);
    assert_true(scene.has_initial && !scene.projected && scene.has_t_end && !scene.has_starts);
    assert_close(scene.t_end, 3, 0, 0);
    assert_int_equal(scene.line_system, 2);
    assert_int_equal(scene.line_form, 3);
    assert_int_equal(scene.segments, 1);
    assert_ok(lg_scene_read(NULL, file_of("scene.json", json_scene), &scene, NULL));
    assert_int_equal(scene.form, LG_SCENE_LAGRANGIAN);
    assert_close(scene.gravity, -9.81, 0, 0);
    assert_close(scene.masses[0], 1, 0, 0);
    assert_close(scene.state[4], 2, 0, 0);
    assert_ok(lg_scene_read(NULL,
                            file_of("flat.yaml", "system: quartic\ninitial: {q: [1, -2], p: [.5, 4]}\n"
                                                 "starts: {kind: box, low: -3, high: 2, segments: 3}\n"),
                            &scene, NULL));
    assert_int_equal(scene.family, LG_HAMILTONIAN_SEPARABLE);
    assert_int_equal(scene.state_size, 4);
    assert_close(scene.state[1], -2, 0, 0);
    assert_close(scene.state[2], 0.5, 0, 0);
    assert_true(scene.has_starts && scene.starts == LG_STARTS_BOX && scene.segments == 3);
    assert_close(scene.low, -3, 0, 0);
    assert_close(scene.high, 2, 0, 0);
    assert_ok(lg_scene_default("pendulum-chain", 3, &scene));
    assert_int_equal(scene.state_size, 18);
    assert_close(scene.masses[2], 1, 0, 0);
    assert_status(lg_scene_default("pendulum", 1, &scene), LG_INVALID_ARGUMENT);
    assert_status(lg_scene_default("pendulum-chain", 0, &scene), LG_INVALID_ARGUMENT);
    char text[4096], small[8];
    int length = lg_scene_describe("pendulum-chain", text, sizeof text);
    assert_int_equal(length, strlen(text));
    assert_non_null(strstr(text, "gravity"));
    assert_int_equal(lg_scene_describe("pendulum-chain", small, sizeof small), length);
    assert_int_equal(lg_scene_describe("nothing", text, sizeof text), 0);
}

static char logged[512];
static void keep_log(void *user, lg_log_level level, const char *message) {
    (void)user, (void)level;
    (void)snprintf(logged, sizeof logged, "%s", message);
}

/* Rounding is projected and told; more is an error. */
static void rounding_is_projected(void **state) {
    (void)state;
    lg_scene scene;
    lg_context_options options;
    lg_context *context;
    lg_context_options_init(&options);
    options.log = keep_log;
    assert_ok(lg_context_create(&options, &context));
    const char *path = changed("near.yaml", good_scene, "[0.6, 0, 0.8]", "[0.6000001, 0, 0.8000002]");
    assert_ok(lg_scene_read(context, path, &scene, NULL));
    assert_true(scene.projected);
    assert_close(scene.projection, 2.2e-7, 0.01, 0);
    const double *q = scene.state;
    assert_close(q[0] * q[0] + q[1] * q[1] + q[2] * q[2], 1, 1e-15, 0);
    assert_close(q[0] / q[2], 0.6000001 / 0.8000002, 1e-15, 0);
    assert_non_null(strstr(logged, "near.yaml"));
    assert_non_null(strstr(logged, "line"));
    path = changed("near.yaml", good_scene, "[1, 0, -3]", "[1, 1e-7, -3]");
    assert_ok(lg_scene_read(context, path, &scene, NULL));
    assert_true(scene.projected);
    assert_close(scene.state[10], 0, 0, 0);
    lg_context_destroy(context);
    assert_refused(read_scene, changed("off.yaml", good_scene, "[0, 1, 0]", "[0, 1.00001, 0]"), LG_FORMAT,
                   "line 9", "sphere");
    assert_refused(read_scene, changed("off.yaml", good_scene, "[0, 2, 0]", "[0.01, 2, 0]"), LG_FORMAT,
                   "line 10", "orthogonal");
}

typedef struct bad_text {
    const char *from, *to, *line, *word;
} bad_text;

static void bad_scenes(void **state) {
    (void)state;
    static const bad_text cases[] = {
        {"gravity: 9.81", "gravity: 9.81m/s", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: 9,81", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: .nan", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: .inf", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: 1e999", "line 4", "finite"},
        {"gravity: 9.81", "gravity: 0x10", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: \"9.81\"", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: [9.81]", "line 4", "gravity"},
        {"gravity: 9.81", "gravity:", "line 4", "gravity"},
        {"gravity: 9.81", "gravity: 9.81\ngravity: 9.81", "line 5", "twice"},
        {"gravity: 9.81\n", "", "line 2", "'gravity' is missing"},
        {"system: pendulum-chain\n", "", "line 2", "'system' is missing"},
        {"system: pendulum-chain", "system: pendulum", "line 2", "pendulum-chain"},
        {"system: pendulum-chain", "system: quartic", "line 4", "does not belong"},
        {"form: hamiltonian", "form: newtonian", "line 3", "form"},
        {"form: hamiltonian", "form: lagrangian", "line 10", "initial.p"},
        {"masses: [1, 1.3]", "masses: [1, 1.3, 2]", "line 6", "lengths"},
        {"masses: [1, 1.3]", "masses: [1, 0]", "line 5", "masses"},
        {"masses: [1, 1.3]", "masses: [1, -2]", "line 5", "masses"},
        {"masses: [1, 1.3]", "masses: []", "line 5", "masses"},
        {"masses: [1, 1.3]", "masses: [1, [1.3]]", "line 5", "masses"},
        {"masses: [1, 1.3]", "masses: {a: 1}", "line 5", "masses"},
        {"masses: [1, 1.3]", "links: 2.5", "line 5", "whole"},
        {"masses: [1, 1.3]", "links: 33", "line 5", "links"},
        {"masses: [1, 1.3]", "links: 3", "line 6", "lengths"},
        {"masses: [1, 1.3]", "mass: [1, 1.3]", "line 5", "unknown key 'mass'"},
        {"masses: [1, 1.3]", "initial.q: [1, 1.3]", "line 5", "unknown key"},
        {"masses: [1, 1.3]", "[1, 2]: 3", "line 5", "key"},
        {"[0, 1, 0]]", "[0, 1]]", "line 9", "3 are expected"},
        {"[0, 1, 0]]", "[0, 1, 0], [0, 0, 1]]", "line 8", "initial.q"},
        {"[0, 1, 0]]", "[0, one, 0]]", "line 9", "'one'"},
        {"[0, 1, 0]]", "0]", "line 9", "initial.q"},
        {"  p: [[0, 2, 0], [1, 0, -3]]\n", "", "line 8", "initial.p"},
        {"  p: [[0, 2, 0], [1, 0, -3]]\n", "  p: [[0, 2, 0]]\n", "line 10", "initial.p"},
        {"  p: ", "  r: ", "line 10", "unknown key 'initial.r'"},
        {"  p: ", "  omega: ", "line 10", "initial.omega"},
        {"t_end: 3", "t_end: 0", "line 11", "t_end"},
        {"t_end: 3", "t_end: -1", "line 11", "t_end"},
        {"t_end: 3", "t_end: 3 s", "line 11", "t_end"},
        {"t_end: 3", "starts: {kind: ball}", "line 11", "starts.kind"},
        {"t_end: 3", "starts: {low: 1}", "line 11", "starts.kind"},
        {"t_end: 3", "starts: {kind: thesis, low: 1}", "line 11", "box"},
        {"t_end: 3", "starts: {kind: box, low: 2, high: 1}", "line 11", "low"},
        {"t_end: 3", "starts: thesis", "line 11", "starts"},
        {"t_end: 3", "starts: {kind: thesis, segments: 0}", "line 11", "segments"},
        {"t_end: 3", "t_end: 3\n---\nsystem: quartic", "line 13", "second document"},
        {"t_end: 3", "t_end: [3", "line", "YAML"},
        {"t_end: 3", "t_end: \x01", "line 11", "YAML"},
        {"t_end: 3", "t_end: *nowhere", "line 11", "YAML"},
        {"t_end: 3", "<<: {a: 1}", "line 11", "unknown key"},
        {"t_end: 3", "a: [[[[[[[[[[[[[[[[[[[[[[", "line 11", "brackets"},
        {"t_end: 3", "\"t\\0end\": 3", "line 11", "unknown key"},
    };
    for (size_t i = 0; i < LG_COUNT(cases); i++)
        assert_refused(read_scene, changed("bad.yaml", good_scene, cases[i].from, cases[i].to), LG_FORMAT,
                       cases[i].line, cases[i].word);
    assert_refused(read_scene, file_of("bad.yaml", "system: quartic\ninitial: {q: [1], p: [1, 2]}\n"),
                   LG_FORMAT, "line 2", "initial.q");
    assert_refused(read_scene, file_of("bad.yaml", "system: quartic\nform: lagrangian\n"), LG_FORMAT,
                   "line 2", "Hamiltonian");
    assert_refused(read_scene, file_of("bad.yaml", "system: pendulum-chain\ngravity: 1\n"), LG_FORMAT,
                   "line 1", "links");
    assert_refused(read_scene, file_of("bad.yaml", "- system\n- quartic\n"), LG_FORMAT, "line 1", "keys");
    assert_refused(read_scene, file_of("bad.yaml", "# only a comment\n"), LG_FORMAT, "line 1", "nothing");
    /* An anchor that holds itself. */
    assert_refused(read_scene, file_of("bad.yaml", "system: quartic\ninitial: &a {q: *a}\n"), LG_FORMAT,
                   "line 2", "initial.q");
}

static void damaged_scenes(void **state) {
    (void)state;
    refuse_damaged_files(read_scene, file_of("scene.json", json_scene), "line");
    survive_changed_bytes(read_scene, file_of("scene.json", json_scene), 300);
    survive_changed_bytes(read_scene, file_of("scene.yaml", good_scene), 300);
    /* A block scene cut short may be a shorter scene; it is read or refused with its line, never worse. */
    for (size_t tenth = 1; tenth < 10; tenth++) {
        lg_error error = {LG_OK, ""};
        const char *bad = scratch_path("cut.yaml");
        write_bytes_to(bad, good_scene, (sizeof good_scene - 1) * tenth / 10);
        lg_status status = read_scene(NULL, bad, NULL, &error);
        assert_true(status == LG_OK ||
                    (status == LG_FORMAT && strstr(error.message, "cut.yaml: line") != NULL));
    }
    /* Large, and deep in a way that costs a slow parser. */
    size_t bytes = (1 << 20) + 1;
    char *big = malloc(bytes);
    assert_non_null(big);
    memset(big, '[', bytes);
    write_bytes_to(scratch_path("big.yaml"), big, bytes);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "larger", "");
    write_bytes_to(scratch_path("big.yaml"), big, bytes - 1);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "line 1", "brackets");
    memset(big, '-', bytes);
    for (size_t i = 1; i < bytes; i += 2) big[i] = ' ';
    write_bytes_to(scratch_path("big.yaml"), big, 20000);
    assert_refused(read_scene, scratch_path("big.yaml"), LG_FORMAT, "line 1", "");
    free(big);
}

/* ---- grids ---- */

static void grid_every_key(void **state) {
    (void)state;
    lg_grid grid;
    (void)file_of("scene.yaml", good_scene);
    assert_ok(lg_grid_read(NULL, file_of("grid.yaml", good_grid), &grid, NULL));
    assert_int_equal(lg_grid_runs(&grid), 2 * 2 * 1 * 3 * 2 * 2 * 5);
    assert_int_equal(grid.scene.links, 2);
    assert_true(grid.integrators[0] == LG_TRAIN_CF4 && grid.integrators[1] == LG_TRAIN_RK4);
    assert_true(grid.n[1] == 500 && grid.m[0] == 5 && grid.m_count == 1 && grid.substeps[1] == 2);
    assert_close(grid.eps[2], 0.1, 0, 0);
    assert_close(grid.penalty[1], 1e-3, 0, 0);
    assert_true(grid.hidden_count == 2 && grid.hidden[1] == 30);
    assert_true(grid.dtype == LG_F32 && grid.potential == LG_POTENTIAL_MLP && grid.activation == LG_TANH);
    assert_true(grid.test_trajectories == 7 && grid.test_points == 9 && grid.seed == UINT64_MAX);
    assert_true(grid.epochs == 100 && grid.batch == 80 && grid.lr_step == 50 && grid.shards == 4);
    assert_close(grid.lr, 1e-2, 0, 0);
    assert_close(grid.t_end, 0.1, 0, 0);
    assert_ok(lg_grid_read(NULL, changed("grid.yaml", good_grid, "t_end: 0.1\n", ""), &grid, NULL));
    assert_close(grid.t_end, 3, 0, 0);
    const char *own = file_of(
        "own.yaml",
        "system: quartic\nt_end: 0.3\nintegrators: stormer-verlet\nN: 900\nM: 6\nhidden: [100, 50, 50]\n");
    assert_ok(lg_grid_read(NULL, own, &grid, NULL));
    assert_string_equal(grid.scene.system, "quartic");
    assert_int_equal(lg_grid_runs(&grid), 1);
    assert_close(grid.t_end, 0.3, 0, 0);
    assert_close(grid.eps[0], 0, 0, 0);
}

static void bad_grids(void **state) {
    (void)state;
    static const bad_text cases[] = {
        {"integrators: [cf4, rk4]", "integrators: [cf4, rk5]", "line 2", "rk5"},
        {"integrators: [cf4, rk4]\n", "", "line 1", "'integrators' is missing"},
        {"N: [50, 500]", "N: [50, 0]", "line 3", "N"},
        {"N: [50, 500]", "N: [50, 1.5]", "line 3", "whole"},
        {"N: [50, 500]", "N: []", "line 3", "N"},
        {"N: [50, 500]", "N: [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]", "line 3", "17"},
        {"M: 5", "M: 1", "line 4", "M"},
        {"M: 5", "M: 5\nM: 5", "line 5", "twice"},
        {"eps: [0, 1e-3, 0.1]", "eps: [0, -1]", "line 5", "eps"},
        {"eps: [0, 1e-3, 0.1]", "eps: [.nan]", "line 5", "eps"},
        {"hidden: [30, 30]", "hidden: [30, 0]", "line 9", "hidden"},
        {"dtype: f32", "dtype: f16", "line 10", "f64, f32"},
        {"test: {trajectories: 7, points: 9}", "test: {trajectories: 7, point: 9}", "line 11", "test.point"},
        {"test: {trajectories: 7, points: 9}", "test: 7", "line 11", "test"},
        {"seed: 18446744073709551615", "seed: -1", "line 12", "seed"},
        {"seed: 18446744073709551615", "seed: 18446744073709551616", "line 12", "seed"},
        {"scene: scene.yaml", "scene: nothing.yaml", "line 1", "nothing.yaml"},
        {"scene: scene.yaml", "scene: [scene.yaml]", "line 1", "scene"},
        {"scene: scene.yaml\n", "", "line 1", "'scene' or 'system'"},
        {"scene: scene.yaml", "scene: scene.yaml\nsystem: quartic", "line 2", "unknown key 'system'"},
        {"repeats: 5", "repeat: 5", "line 8", "unknown key"},
        {"t_end: 0.1", "t_end: 0", "line 13", "t_end"},
        {"t_end: 0.1", "lr: 0", "line 13", "lr"},
    };
    (void)file_of("scene.yaml", good_scene);
    for (size_t i = 0; i < LG_COUNT(cases); i++) {
        lg_status expected = strcmp(cases[i].word, "nothing.yaml") == 0 ? LG_NOT_FOUND : LG_FORMAT;
        assert_refused(read_grid, changed("bad.yaml", good_grid, cases[i].from, cases[i].to), expected,
                       cases[i].line, cases[i].word);
    }
    /* A broken scene is told with its own line, and the grid's. */
    (void)changed("scene.yaml", good_scene, "gravity: 9.81", "gravity: heavy");
    assert_refused(read_grid, file_of("bad.yaml", good_grid), LG_FORMAT, "line 1", "line 4");
    assert_refused(read_grid, file_of("bad.yaml", "system: quartic\nintegrators: rk4\nN: 1\nM: 2\n"),
                   LG_FORMAT, "t_end", "line 1");
}

static void damaged_grids(void **state) {
    (void)state;
    static const char json[] =
        "{\"system\": \"coupled-oscillators\", \"t_end\": 0.1, \"integrators\": [\"stormer-verlet\"],\n"
        " \"N\": [900], \"M\": [2], \"eps\": [0.1, 0.2], \"penalty\": [0, 1],\n"
        " \"hidden\": [30, 30], \"penalty_form\": \"published\"}";
    refuse_damaged_files(read_grid, file_of("grid.json", json), "line");
    survive_changed_bytes(read_grid, file_of("grid.json", json), 300);
}

/* ---- what comes with the program ---- */

static void own_scenes(void **state) {
    (void)state;
    static const struct {
        const char *name;
        uint32_t links;
        const char *system;
    } scenes[] = {{"pendulum", 1, "pendulum-chain"},
                  {"double-pendulum", 2, "pendulum-chain"},
                  {"chain5", 5, "pendulum-chain"},
                  {"quartic", 2, "quartic"},
                  {"coupled-oscillators", 2, "coupled-oscillators"}};
    char path[512];
    lg_grid grid;
    for (size_t i = 0; i < LG_COUNT(scenes); i++) {
        lg_scene scene;
        (void)snprintf(path, sizeof path, "%s/../scenes/%s.yaml", LG_TEST_DIR, scenes[i].name);
        assert_ok(lg_scene_read(NULL, path, &scene, NULL));
        assert_string_equal(scene.system, scenes[i].system);
        assert_int_equal(scene.links, scenes[i].links);
        assert_int_equal(scene.form, LG_SCENE_HAMILTONIAN);
        assert_true(scene.has_t_end);
    }
    (void)snprintf(path, sizeof path, "%s/../scenes/study-thesis.yaml", LG_TEST_DIR);
    assert_ok(lg_grid_read(NULL, path, &grid, NULL));
    assert_int_equal(lg_grid_runs(&grid), 960);
    (void)snprintf(path, sizeof path, "%s/../scenes/study-small.yaml", LG_TEST_DIR);
    assert_ok(lg_grid_read(NULL, path, &grid, NULL));
    assert_int_equal(lg_grid_runs(&grid), 96);
}

/* ---- memory ---- */

static lg_status scene_step(const lg_context *context, void *user, lg_error *error) {
    return read_scene(context, user, NULL, error);
}
static lg_status grid_step(const lg_context *context, void *user, lg_error *error) {
    return read_grid(context, user, NULL, error);
}

static void failing_allocations(void **state) {
    (void)state;
    const char *scene = file_of("scene.yaml", good_scene), *grid = file_of("grid.yaml", good_grid);
    assert_int_equal(fail_every_allocation(scene_step, (void *)scene), 3);
    assert_int_equal(fail_every_allocation(grid_step, (void *)grid), 7);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_key),           cmocka_unit_test(rounding_is_projected),
        cmocka_unit_test(bad_scenes),          cmocka_unit_test(damaged_scenes),
        cmocka_unit_test(grid_every_key),      cmocka_unit_test(bad_grids),
        cmocka_unit_test(damaged_grids),       cmocka_unit_test(own_scenes),
        cmocka_unit_test(failing_allocations),
    };
    return cmocka_run_group_tests(tests, scratch_begin, scratch_end);
}
