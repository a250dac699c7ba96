/* Certificates as files: what is written is read and proved again; changes are found; hostile files are not
 * accepted.
 * ctest-labels: src/certify src/settings/files */
#include "support/io_test.h"

#include "certify_support.h"
#include "core/text.h"
#include "liegrad/files.h"

/* A Van der Pol oscillator backwards, and what all other operations add near its equilibrium. */
typedef struct oscillator {
    double more, damping, limit;
} oscillator;

static lg_var others(lg_tape *tape, lg_var x, lg_var y) {
    const lg_var high = lg_add_scalar(tape, x, 20), w = lg_square(tape, x);
    const lg_var all[] = {lg_div(tape, x, high),
                          lg_sqrt(tape, high),
                          lg_pow(tape, high, 1.5),
                          lg_exp(tape, lg_scale(tape, x, 0.1)),
                          lg_log(tape, high),
                          lg_sin(tape, y),
                          lg_sub(tape, lg_cos(tape, x), y),
                          lg_act(tape, y, LG_TANH),
                          lg_act(tape, x, LG_SIGMOID),
                          lg_atan2(tape, y, high),
                          lg_max(tape, y, lg_neg(tape, high)),
                          lg_abs(tape, high),
                          lg_mul(tape, lg_ge(tape, high, y), x),
                          lg_select(tape, lg_ge(tape, high, y), y, x),
                          lg_mul(tape, lg_sign(tape, high), y),
                          lg_slice(tape, lg_stumpff_functions(tape, w, 3), 1, 2, 1),
                          lg_dexpinv_coefficient(tape, w, 0)};
    lg_var sum = LG_NONE;
    for (size_t i = 0; i < LG_COUNT(all); i++) sum = i == 0 ? all[i] : lg_add(tape, sum, all[i]);
    return sum;
}

static lg_status rate(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const oscillator *o = user;
    const lg_var x = column(tape, in[0], 0), y = column(tape, in[0], 1),
                 bent = lg_mul(tape, lg_add_scalar(tape, lg_square(tape, x), -1), y);
    lg_var rise = lg_add(tape, lg_add(tape, x, bent), in[1]);
    if (o->more != 0) rise = lg_add(tape, rise, lg_scale(tape, others(tape, x, y), o->more));
    out[0] = lg_concat(tape, (const lg_var[]){lg_neg(tape, y), rise}, 2, 1);
    return lg_tape_status(tape);
}

static lg_status control(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const oscillator *o = user;
    out[0] = saturated(tape, lg_scale(tape, column(tape, in[0], 1), -o->damping), o->limit);
    return lg_tape_status(tape);
}

static lg_status closed(void *user, lg_tape *tape, const lg_var *theta, const lg_var *in, lg_var *out) {
    const lg_var u = lg_program_call(tape, "control", 0, in);
    out[0] = lg_program_call(tape, "rate", 0, (const lg_var[]){in[0], u});
    return lg_tape_status(tape);
}

static lg_program *oscillator_program(double more, double damping) {
    static oscillator kept[16];
    static size_t used;
    oscillator *o = &kept[used++ % LG_COUNT(kept)];
    *o = (oscillator){more, damping, 1};
    const lg_port in[2] = {{.name = "x", .shape = lg_shape1(2)}, {.name = "u", .shape = lg_shape1(1)}},
                  out = {.name = "y"};
    const lg_function_spec functions[3] = {{"rate", in, 2, &out, 1, rate, o},
                                           {"control", in, 1, &out, 1, control, o},
                                           {"closed", in, 1, &out, 1, closed, o}};
    const lg_program_spec spec = spec_of(NULL, 0, functions, 3);
    return test_program(&spec);
}

static const double form[4] = {1.5, -0.5, -0.5, 1}, low[2] = {-3, -3}, high[2] = {3, 3},
                    errors[2] = {0.002, 0.001};

typedef enum loop { HELD, HELD_ERROR, CONTINUOUS, CLOSED, LOOPS } loop;

static lg_certify_spec spec_of_loop(const lg_program *program, loop which) {
    lg_certify_spec spec = spec_for(program, form, low, high);
    const bool held = which <= HELD_ERROR;
    spec.rate = held ? "rate" : "closed";
    spec.control = held ? "control" : NULL;
    spec.period = held ? 0.1 : 0;
    spec.model_error = which == HELD_ERROR ? errors : NULL;
    return spec;
}

OWNED(lg_certificate, lg_certificate_destroy)

static lg_certificate *certificate_of(const lg_program *program, loop which) {
    lg_certify_spec spec = spec_of_loop(program, which);
    lg_certificate made;
    const lg_certify_result proved = prove(&spec, 60);
    assert_true(proved.verified);
    if (which == CONTINUOUS) spec.rate = "rate", spec.control = "control";
    assert_told(lg_certificate_make(NULL, &spec, &proved, 60, &made, &told));
    (void)snprintf(made.names[0], sizeof made.names[0], "x");
    (void)snprintf(made.names[1], sizeof made.names[1], "\"y\\ \xc3\xa4");
    (void)snprintf(made.plant, sizeof made.plant, "Van der Pol");
    (void)snprintf(made.controller, sizeof made.controller, "damping");
    return own_lg_certificate(made);
}

static lg_certificate *loaded(const char *path) {
    lg_certificate made;
    assert_told(lg_certificate_load(NULL, path, &made, &told));
    return own_lg_certificate(made);
}

/* Whether it is proved again; `claim` (may be NULL) becomes the sentence */
static bool holds(const lg_certificate *file, char *claim) {
    lg_certify *certify = NULL;
    lg_certify_result r;
    if (lg_certify_open(NULL, file, 1, &certify, NULL) != LG_OK) return false;
    assert_told(lg_certify_run(certify, SIZE_MAX, 60, &r, &told));
    if (claim != NULL) (void)snprintf(claim, LG_CERTIFICATE_CLAIM, "%s", r.claim);
    if (!r.verified) assert_true(r.reason[0] != '\0' && r.failed_low != NULL);
    lg_certify_destroy(certify);
    return r.verified;
}

static void same_code(const lg_certificate_code *a, const lg_certificate_code *b) {
    assert_true(a->inputs == b->inputs && a->lines == b->lines && a->outputs == b->outputs);
    assert_memory_equal(a->line, b->line, a->lines * sizeof *a->line);
    assert_memory_equal(a->output, b->output, a->outputs * sizeof *a->output);
}

TEST("certificates of held, continuous and closed loops, with all operations, are written, read and proved") {
    bool seen[32] = {false};
    for (int more = 0; more < 2; more++)
        for (int which = HELD; which < LOOPS; which++) {
            const size_t mark = lg_test_owned();
            const lg_certificate *file = certificate_of(oscillator_program(1e-3 * more, 0.5), (loop)which);
            const char *path = scratch_path("c.json"), *again = scratch_path("again.json");
            char claim[LG_CERTIFICATE_CLAIM];
            assert_told(lg_certificate_save(NULL, path, file, &told));
            const lg_certificate *back = loaded(path);
            assert_told(lg_certificate_save(NULL, again, back, &told));
            assert_same_bytes(path, again);
            same_code(&file->rate, &back->rate);
            same_code(&file->control, &back->control);
            assert_string_equal(file->tree, back->tree);
            assert_string_equal(file->names[1], back->names[1]);
            assert_true(holds(back, claim));
            assert_string_equal(claim, back->claim);
            assert_true(back->converges == (more == 0 && which != HELD_ERROR));
            assert_true(back->inputs == (which == CLOSED ? 0 : 1));
            for (size_t i = 0; i < back->rate.lines; i++) seen[back->rate.line[i].op] = true;
            lg_test_give_back(mark);
        }
    for (size_t op = 0; op < 23; op++)
        if (!seen[op]) fail_msg("operation %zu is in no certificate", op);
}

TEST("one state, and a goal away from 0") {
    static const double P = 2, from = -1, to = 3, goal = 0.5;
    lg_certificate file = {.context = NULL};
    lg_certificate_line line[] = {{0, {0}, 0}, {1, {0}, 0.5}, {3, {1, 0}, 0}};
    uint32_t output[] = {2};
    file.states = 1;
    file.rate = (lg_certificate_code){1, 3, 1, line, output};
    file.goal[0] = goal, file.low[0] = from, file.high[0] = to, file.P[0] = P;
    file.level = 2, file.eps = 1, file.even = false;
    file.T[0] = sqrt(0.5);
    file.near[0] = 1.1, file.from[0] = -1.5, file.to[0] = 1.5;
    file.tree = test_text("a\naa\n0nn0\n");
    file.boxes = 7;
    const char *path = scratch_path("one.json");
    (void)snprintf(file.claim, sizeof file.claim, "x");
    assert_status(lg_certificate_save(NULL, path, &file, NULL), LG_INVALID_ARGUMENT); /* no names */
    (void)snprintf(file.plant, sizeof file.plant, "plant");
    (void)snprintf(file.controller, sizeof file.controller, "none");
    assert_told(lg_certificate_save(NULL, path, &file, &told));
    assert_true(holds(loaded(path), file.claim));
    assert_says(file.claim, "reach {V < eps} about the goal");
    line[1].number = 1.75; /* another equilibrium */
    assert_false(holds(&file, NULL));
}

TEST("a certificate may have no bound between the samples") {
    lg_certificate *file = certificate_of(oscillator_program(0, 0.5), HELD);
    const char *path = scratch_path("unbounded.json");
    file->between = INFINITY;
    assert_told(lg_certificate_save(NULL, path, file, &told));
    assert_true(isinf(loaded(path)->between));
    assert_true(holds(loaded(path), file->claim));
}

/* ---- changes ---- */

/* A change of a certificate that is proved, or false where this loop has nothing to change. `afresh`: the
 * claim that changes may be true, too, and then is a different one. */
typedef struct change_of {
    const char *what;
    bool (*apply)(lg_certificate *file);
    bool afresh;
} change_of;

#define CHANGE(name) static bool name(lg_certificate *f)
#define SIMPLE(name, statement)                                                                              \
    CHANGE(name) {                                                                                           \
        statement;                                                                                           \
        return true;                                                                                         \
    }

static bool change_number(lg_certificate_code *code, double by) {
    for (size_t i = code->lines; i-- > 0;)
        if (code->line[i].op == 1) return code->line[i].number *= by, true;
    return false;
}
CHANGE(rate_slightly) {
    return change_number(&f->rate, 1 + 1e-3);
}
CHANGE(rate_much) {
    return change_number(&f->rate, -1);
}
CHANGE(control_slightly) {
    return change_number(&f->control, 1 + 1e-3);
}
CHANGE(control_sign) {
    for (size_t i = 0; i < f->control.lines; i++)
        if (f->control.line[i].op == 1 && fabs(f->control.line[i].number) == 0.5)
            return f->control.line[i].number *= -12, true;
    return false;
}
static bool change_leaf(lg_certificate *f, char from, char to) {
    char *at = strchr(f->tree, from);
    if (at != NULL) *at = to;
    return at != NULL;
}
CHANGE(leaf_outside) {
    return change_leaf(f, '0', 'o');
}
CHANGE(leaf_near) {
    return change_leaf(f, '0', 'n');
}
CHANGE(leaf_falls) {
    return f->converges ? change_leaf(f, 'n', '0') : false;
}
CHANGE(leaf_unknown) {
    return change_leaf(f, '0', 'z');
}
CHANGE(leaf_steps) {
    return f->period > 0 ? false : change_leaf(f, '0', '4');
}
CHANGE(split_gone) {
    return change_leaf(f, 'a', '0');
}
CHANGE(split_other) {
    return change_leaf(f, 'a', 'c');
}
CHANGE(leaf_splits) {
    return change_leaf(f, '0', 'a');
}
CHANGE(tree_short) {
    char *last = strrchr(f->tree, '\n');
    *last = '\0';
    return true;
}
CHANGE(tree_long) {
    f->tree = test_text("%s0\n", f->tree); /* the old text lives on in the test's memory */
    return true;
}
CHANGE(shorter_steps) {
    if (f->period == 0) return false;
    f->steps = 3;
    return true;
}
CHANGE(no_steps) {
    if (f->period == 0) return false;
    f->steps = 0;
    return true;
}
CHANGE(other_order) {
    if (f->period == 0) return false;
    f->order = 5;
    return true;
}
CHANGE(longer_period) {
    f->period *= 6;
    return f->period > 0;
}
CHANGE(claims_convergence) {
    if (f->converges) return false;
    return f->converges = true;
}
CHANGE(claims_less) {
    if (!f->converges) return false;
    f->converges = false;
    return true;
}
CHANGE(between_low) {
    f->between = 0.95 * f->level + 0.05 * f->between;
    return f->period > 0;
}
CHANGE(between_high) {
    f->between *= 1.1;
    return f->period > 0;
}
CHANGE(no_error) {
    const bool had = f->error[0] > 0;
    f->error[0] *= 0.5;
    return had;
}
/* Without convergence N only bounds where leaves are near. */
CHANGE(near_large) {
    f->near[0] *= 40;
    return f->converges;
}
SIMPLE(root_small, f->to[0] *= 0.99)
SIMPLE(root_half, f->from[1] = 0)
SIMPLE(near_small, f->near[0] *= 0.9)
SIMPLE(near_nan, f->near[0] = NAN)
SIMPLE(level_up, f->level *= 1.05)
SIMPLE(level_down, f->level *= 0.999)
SIMPLE(level_nan, f->level = NAN)
SIMPLE(eps_down, f->eps *= 1e-3)
SIMPLE(eps_up, f->eps *= 1.5)
SIMPLE(form_larger, (f->P[0] *= 1.01))
SIMPLE(form_crooked, f->P[1] *= 1.0001)
SIMPLE(form_indefinite, f->P[1] = f->P[2] = 2)
SIMPLE(coordinates, f->T[1] += 1e-3)
SIMPLE(goal_moved, f->goal[0] = 0.01)
SIMPLE(box_small, f->high[1] = 0.9)
SIMPLE(error_large, f->error[1] = 0.5)
SIMPLE(error_small, f->error[1] += 1e-9)

TEST("changes of a certificate are found, or the changed claim is proved") {
    static const change_of changes[] = {{"a coefficient of the rate", rate_slightly, true},
                                        {"the rate", rate_much, false},
                                        {"a coefficient of the control", control_slightly, true},
                                        {"the control's sign", control_sign, false},
                                        {"a leaf outside", leaf_outside, false},
                                        {"a leaf near", leaf_near, false},
                                        {"a leaf at the goal that falls", leaf_falls, true},
                                        {"a leaf without a meaning", leaf_unknown, false},
                                        {"a leaf with steps", leaf_steps, true},
                                        {"a split that is a leaf", split_gone, false},
                                        {"a split along no side", split_other, false},
                                        {"a leaf that is split", leaf_splits, false},
                                        {"a tree without its last line", tree_short, false},
                                        {"a tree with one more line", tree_long, false},
                                        {"three steps", shorter_steps, false},
                                        {"no steps", no_steps, false},
                                        {"the order", other_order, false},
                                        {"the period", longer_period, false},
                                        {"convergence", claims_convergence, false},
                                        {"no convergence", claims_less, true},
                                        {"a low bound between samples", between_low, false},
                                        {"a high bound between samples", between_high, true},
                                        {"a smaller error", no_error, true},
                                        {"a root box that is too small", root_small, false},
                                        {"half of the root box", root_half, false},
                                        {"a small neighbourhood", near_small, false},
                                        {"a large neighbourhood", near_large, false},
                                        {"a neighbourhood of NaN", near_nan, false},
                                        {"a level above", level_up, false},
                                        {"a level below", level_down, true},
                                        {"a level of NaN", level_nan, false},
                                        {"a small eps", eps_down, true},
                                        {"a large eps", eps_up, false},
                                        {"a form that is larger", form_larger, false},
                                        {"a form that is not symmetric", form_crooked, false},
                                        {"an indefinite form", form_indefinite, false},
                                        {"coordinates", coordinates, false},
                                        {"the goal", goal_moved, false},
                                        {"a box that cuts the set", box_small, false},
                                        {"a large error", error_large, false},
                                        {"a small error", error_small, true}};
    size_t applied[LG_COUNT(changes)] = {0};
    for (int which = HELD; which < LOOPS; which++) {
        const lg_certificate *good = certificate_of(oscillator_program(0, 0.5), (loop)which);
        const char *path = scratch_path(test_text("change%d.json", which));
        assert_told(lg_certificate_save(NULL, path, good, &told));
        for (size_t k = 0; k < LG_COUNT(changes); k++) {
            const size_t mark = lg_test_owned();
            lg_certificate *file = loaded(path);
            char *tree = file->tree, claim[LG_CERTIFICATE_CLAIM];
            if (changes[k].apply(file)) {
                applied[k]++;
                if (holds(file, claim) && !changes[k].afresh)
                    fail_msg("loop %d, %s: not found: %s", which, changes[k].what, claim);
            }
            file->tree = tree;
            lg_test_give_back(mark);
        }
    }
    for (size_t k = 0; k < LG_COUNT(changes); k++)
        if (applied[k] == 0) fail_msg("%s: was never applied", changes[k].what);
}

TEST("the loop of a program is compared with that of a certificate: plant and controller apart") {
    const lg_certificate *file = certificate_of(oscillator_program(0, 0.5), HELD);
    const struct { double more, damping; } loops[] = {{0, 0.5}, {0, 0.5 + 1e-12}, {1e-300, 0.5}, {1e-9, 0.4}};
    for (size_t i = 0; i < LG_COUNT(loops); i++) {
        bool plant, controller;
        assert_told(lg_certificate_compare(file, oscillator_program(loops[i].more, loops[i].damping), "rate",
                                           "control", &plant, &controller, &told));
        assert_true(plant == (loops[i].more == 0) && controller == (loops[i].damping == 0.5));
    }
}

TEST("what has no certificate is said") {
    const lg_program *program = oscillator_program(0, 0.5);
    lg_certify_spec spec = spec_of_loop(program, CLOSED);
    const lg_certify_result proved = prove(&spec, 60);
    lg_certificate made;
    lg_error error;
    spec.step = true;
    assert_status(lg_certificate_make(NULL, &spec, &proved, 60, &made, &error), LG_UNSUPPORTED);
    assert_says(error.message, "for a quadratic V");
    spec.step = false;
    spec.P = NULL;
    spec.lyapunov = "closed";
    assert_status(lg_certificate_make(NULL, &spec, &proved, 60, &made, &error), LG_UNSUPPORTED);
    spec = spec_of_loop(program, CLOSED);
    lg_certify_result failed = proved;
    failed.verified = false;
    assert_status(lg_certificate_make(NULL, &spec, &failed, 60, &made, &error), LG_INVALID_ARGUMENT);
    assert_status(lg_certificate_make(NULL, &spec, &proved, 0, &made, &error), LG_CHECK_FAILED);
    assert_says(error.message, "the time ended");
}

/* ---- files ---- */

static lg_status read_file(const lg_context *context, const char *path, const lg_read_options *options,
                           lg_error *error) {
    lg_certificate file;
    lg_certify *certify = NULL;
    (void)options;
    LG_TRY(lg_certificate_load(context, path, &file, error));
    lg_status status = lg_certify_open(context, &file, 1, &certify, error);
    if (status == LG_INVALID_ARGUMENT)
        status = lg_fail(error, LG_FORMAT, "%s: %s", path, test_text("%s", error->message));
    lg_certify_destroy(certify);
    lg_certificate_destroy(&file);
    return status;
}

static const char *good_file(void) {
    const char *path = scratch_path("good.json");
    if (access(path, F_OK) != 0)
        assert_told(lg_certificate_save(NULL, path, certificate_of(oscillator_program(0, 0.5), HELD), &told));
    return path;
}

TEST("hostile files are rejected with a sentence") {
    static const struct {
        const char *from, *to, *says;
        lg_status status;
    } rows[] = {
        {"\"version\": 1", "\"version\": 2", "version 2 of certificates is unknown", LG_FORMAT},
        {"\"format\": \"liegrad", "\"format\": \"other", "\"format\" must be", LG_FORMAT},
        {"\"states\": 2", "\"states\": 3", "a name for each state", LG_FORMAT},
        {"\"states\": 2", "\"states\": 4294967297", "states", LG_FORMAT},
        {"\"states\": 2", "\"states\": 0", "states", LG_FORMAT},
        {"\"inputs\": 1", "\"inputs\": 2", "is not of 2 states and 2 inputs", LG_FORMAT},
        {"\"period\": 0.1", "\"period\": 0", "\"period\" above 0", LG_FORMAT},
        {"\"period\": 0.1", "\"period\": .nan", "period", LG_FORMAT},
        {"\"goal\": [0, 0]", "\"goal\": [0]", "a number for each state", LG_FORMAT},
        {"\"goal\": [0, 0]", "\"goal\": [0, null]", "a finite number", LG_FORMAT},
        {"\"goal\": [0, 0]", "\"goal\": [0, [0]]", "a finite number", LG_FORMAT},
        {"\"goal\": [0, 0]", "\"goal\": {}", "a number for each state", LG_FORMAT},
        {"\"stored\": 0", "\"stored\": 1", "stored", LG_FORMAT},
        {"\"level\": ", "\"level\": -", "level", LG_FORMAT},
        {"\"steps\": ", "\"steps\": 99999", "steps", LG_FORMAT},
        {"\"boxes\": ", "\"boxes\": 1", "boxes", LG_FORMAT},
        {"\"boxes\": ", "\"b\": ", "unknown key", LG_FORMAT},
        {"[\"in\", 1]", "[\"in\", 7]", "SHA-256", LG_CHECK_FAILED},
        {"[\"in\", 1]", "[\"in\", 1.5]", "SHA-256", LG_CHECK_FAILED},
        {"[\"in\", 1]", "[\"in\"]", "other operands", LG_FORMAT},
        {"[\"in\", 1]", "[\"fly\", 1]", "operation is unknown", LG_FORMAT},
        {"[\"in\", 1]", "[]", "operation is unknown", LG_FORMAT},
        {"[\"mul\", ", "[\"mul\", 1e9", "other operands", LG_FORMAT},
        {"[\"neg\", ", "[\"neg\", -1", "other operands", LG_FORMAT},
        {"\"sha256\": \"", "\"sha256\": \"0", "SHA-256", LG_CHECK_FAILED},
        {"\"claim\": \"", "\"claim\": [\"", "", LG_FORMAT},
        {"\"tree\": [\"", "\"tree\": [\"a", "boxes", LG_FORMAT},
    };
    size_t size;
    const char *good = (const char *)read_bytes_of(good_file(), &size);
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const char *at = strstr(good, rows[i].from), *path = scratch_path("bad.json");
        lg_error error = {LG_OK, ""};
        if (at == NULL) fail_msg("'%s' is not in the file", rows[i].from);
        write_text_to(path,
                      test_text("%.*s%s%s", (int)(at - good), good, rows[i].to, at + strlen(rows[i].from)));
        const lg_status status = read_file(NULL, path, NULL, &error);
        if (status != rows[i].status || strstr(error.message, rows[i].says) == NULL)
            fail_msg("'%s': %s: %s", rows[i].to, lg_status_name(status), error.message);
    }
}

TEST("damaged files, files with changed bytes, and failing allocations") {
    refuse_damaged_files(read_file, good_file(), "");
    survive_changed_bytes(read_file, good_file(), 400);
    assert_true(fail_every_reading(read_file, good_file()) > 10);
}

static void read_deep(void *user) {
    lg_certificate file;
    lg_error error;
    (void)lg_certificate_load(NULL, user, &file, &error);
}

TEST("a tree of a hundred thousand levels takes little time") {
    size_t size;
    const char *good = (const char *)read_bytes_of(good_file(), &size), *at = strstr(good, "\"tree\": [");
    lg_text text = {.context = NULL};
    lg_text_append(&text, good, (size_t)(at - good));
    lg_text_add(&text, "\"tree\": [\"a\"");
    for (int i = 0; i < 100000; i++) lg_text_add(&text, ",\"oa\"");
    lg_text_add(&text, "]}}\n");
    write_text_to(scratch_path("deep.json"), text.data);
    lg_text_destroy(&text);
    assert_cheap(read_deep, (void *)scratch_path("deep.json"));
}
