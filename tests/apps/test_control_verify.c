/* lg-control certify --certificate and lg-control verify: exit codes, and what is found.
 * ctest-labels: apps/lg-control src/certify */
#include "cli_support.h"

static const char control[] = "lg-control";
static char text[CLI_TEXT];

/* A pendulum with a motor: m .15, l .5, b .1. */
static void write_plant(const char *name, double damping) {
    cli_write(name, test_text("columns: {time: t}\ncoordinates: [{name: th, kind: angle, velocity: w}]\n"
                              "inputs: {columns: [u]}\nmass: {kind: known, values: [0.0375]}\npotential: "
                              "{kind: known, form: polynomial, of: th, degree: 1, values: [0, 0.73575]}\n"
                              "damping: {kind: known, values: [%.17g]}\ninput_map: {kind: known, values: "
                              "[[1]]}\n",
                              damping));
}

static void write_task(const char *name, const char *plant, double period, const char *gains) {
    cli_write(name, test_text("plant: %s\nperiod: %g\nhorizon: 5\nstarts: {th: [-3.14, 3.14], w: [-1, 1]}\n"
                              "limits: {u: 0.75}\ncost: {th: 1, w: 0.02, u: 0.02}\nsuccess: {th: 0.05, "
                              "hold: 1, within: 8}\ncontroller: {kind: lqr, gains: [%s]}\n",
                              plant, period, gains));
}

/* Writes `name`, the certificate with `from` replaced by `to` at its first place. */
static void change(const char *name, const char *from, const char *to) {
    (void)cli_read("good.json", text, sizeof text);
    const char *at = strstr(text, from);
    if (at == NULL) fail_msg("'%s' is not in the certificate", from);
    cli_write(name, test_text("%.*s%s%s", (int)(at - text), text, to, at + strlen(from)));
}

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    write_plant("light.yaml", 0.1);
    write_plant("sticky.yaml", 0.1 + 1e-9);
    write_task("task.yaml", "light.yaml", 0.01, "1.45, 0.244");
    write_task("other_plant.yaml", "sticky.yaml", 0.01, "1.45, 0.244");
    write_task("other_gains.yaml", "light.yaml", 0.01, "1.45, 0.2440001");
    write_task("other_period.yaml", "light.yaml", 0.02, "1.45, 0.244");
    cli_run(control, "certify task.yaml --box th=1.5,w=12 --held --certificate good.json --json");
    return 0;
}

TEST("a certificate is proved again, alone and for its task; another loop is found by its part") {
    const struct {
        const char *task, *says;
    } others[] = {{"other_plant.yaml", "other_plant.yaml has another plant"},
                  {"other_gains.yaml", "other_gains.yaml has another controller"},
                  {"other_period.yaml", "other_period.yaml has another period"}};
    assert_true(strstr(result.out, "\"verified\": true") != NULL || cli_exists("good.json"));
    cli_expect(control, "verify good.json", 0, "Proved: in the box");
    cli_expect(control, "verify good.json --json", 0, "\"verified\": true, \"converges\": true");
    assert_true(json_number(result.out, "boxes") > 50);
    cli_expect(control, "verify good.json task.yaml --json", 0,
               "\"same_plant\": true, \"same_controller\": true, \"same_period\": true");
    for (size_t i = 0; i < LG_COUNT(others); i++) {
        cli_expect(control, test_text("verify good.json %s", others[i].task), 1, others[i].says);
        assert_true(strstr(result.err, " and another") == NULL);
    }
    cli_run(control, "train task.yaml --out policy.h5");
    cli_expect(control, "verify good.json policy.h5", 0, "Proved");
}

TEST("files that were changed fail with what is wrong") {
    const struct {
        const char *from, *to;
        int code;
        const char *says;
    } rows[] = {{"[\"number\", ", "[\"number\", -", 3, "does not have the SHA-256 of \"plant\""},
                {"\"sha256\": \"", "\"sha256\": \"0", 3, "does not have the SHA-256"},
                {"\"version\": 1", "\"version\": 2", 3, "version 2 of certificates"},
                {"\"steps\": ", "\"steps\": 30", 3, "a power of 2"},
                {"\"in\", 0", "\"in\", 9", 3, "SHA-256"},
                {"converge to the goal", "converge to the moon", 1, "claims something else"},
                {"\"level\": 0.", "\"level\": 1.", 1, "not proved"},
                {"\"period\": 0.01", "\"period\": 0.11", 1, "not proved"},
                {"\"even\": true", "\"even\": false", 1, "the root box"},
                {"\"error\": [0, 0]", "\"error\": [0, 0.1]", 1, "not proved"},
                {"\"order\": 6", "\"order\": 9", 1, "another order"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        change("bad.json", rows[i].from, rows[i].to);
        cli_expect(control, "verify bad.json", rows[i].code, rows[i].says);
    }
    change("bad.json", "\"near\": [0.", "\"near\": [9.");
    cli_expect(control, "verify bad.json --json", 1, "not proved");
    assert_says(result.out, "\"verified\": false");
    assert_true(json_find(result.out, "failed") != NULL && json_find(result.out, "reason") != NULL);
    change("bad.json", "[\"th\", \"w\"]", "[\"w\", \"th\"]");
    cli_expect(control, "verify bad.json task.yaml", 1, "another list of states");
    cli_write("bad.json", "{}");
    cli_expect(control, "verify bad.json", 3, "version");
    cli_expect(control, "verify task.yaml", 3, "task.yaml");
}

TEST("a proof that succeeds in the time has its certificate, which is not limited by --seconds") {
    size_t proofs = 0, late = 0;
    for (double seconds = 8; seconds > 1e-3; seconds *= 0.5) {
        cli_run_limited(control,
                        test_text("certify task.yaml --box th=1.5,w=12 --model-error 1e-5 --seconds %g "
                                  "--certificate late.json --json",
                                  seconds),
                        0);
        const bool proved = strstr(result.out, "\"verified\": true") != NULL;
        const bool ended = strstr(result.err, "neither proved nor refuted") != NULL;
        if (proved == ended || proved != (result.code == 0) || proved != cli_exists("late.json"))
            fail_msg("--seconds %g: exit code %d, %s", seconds, result.code, result.err);
        *(proved ? &proofs : &late) += 1;
        if (proved) cli_unlink("late.json");
    }
    assert_true(proofs > 0 && late > 0);
}

TEST("a certificate can be read whatever the names of its files are") {
    char cut[80] = "", *const names[] = {cut, "x\xfc.yaml"}; /* 33 umlauts, cut at 63 bytes; Latin-1 */
    for (int i = 0; i < 33; i++) memcpy(cut + 2 * i, "\xc3\xbc", 3);
    memcpy(cut + 66, ".yaml", 6);
    for (size_t i = 0; i < LG_COUNT(names); i++) {
        write_task(names[i], "light.yaml", 0.01, "1.45, 0.244");
        cli_expect(control, test_text("certify %s --box th=1.5,w=12 --certificate named.json", names[i]), 0,
                   "Proved");
        cli_expect(control, test_text("verify named.json %s", names[i]), 0, "Proved");
    }
}

TEST("there is a certificate only of what is proved, with a quadratic V") {
    cli_expect(control, "certify task.yaml --box th=1.5,w=12 --held --level 3 --certificate none.json", 1,
               "not proved");
    assert_false(cli_exists("none.json"));
    cli_expect(control, "certify task.yaml --box th=1,w=5 --lyapunov polynomial --certificate none.json", 2,
               "quadratic V");
    cli_expect(control, "certify task.yaml --box th=1.5,w=12 --certificate open.json", 0, "Proved");
    cli_expect(control, "verify open.json task.yaml", 0, "Proved");
    /* Continuous inputs have no period: what the task does is said. */
    cli_expect(control, "certify task.yaml --box th=1.5,w=12 --continuous --certificate open.json", 0, "");
    cli_expect(control, "verify open.json", 0, "continuous inputs");
    assert_true(strstr(result.out, "the controller holds them") == NULL);
    cli_expect(control, "verify open.json other_period.yaml --json", 0, "\"same_period\": false");
    assert_says(result.out,
                "It is about inputs that follow the state at all times; the controller holds them for 0.02.");
    cli_expect(control, "certify task.yaml --box th=1.5,w=12 --held --certificate task.yaml", 2, "task.yaml");
    cli_expect(control, "certify task.yaml --box th=1.5,w=12 --held --certificate light.yaml", 2,
               "is an input");
    cli_expect(control,
               "certify task.yaml --box th=1.5,w=12 --held --model-error 1e-4 --certificate error.json", 0,
               "may err");
    cli_expect(control, "verify error.json other_plant.yaml", 1, "another plant");
    cli_expect(control, "verify error.json task.yaml", 0, "may err");
}

TEST_GROUP(setup, cli_end)
