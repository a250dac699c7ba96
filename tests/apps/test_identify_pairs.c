/* lg-identify fit --suggest on a log that asks for two terms at once.
 * ctest-labels: slow apps/lg-identify src/machine */
#include "identify_support.h"

static const double every = 0.005;

/* A drive of 95 kg that follows two sines: viscous and Coulomb friction, and a constant force. */
static void write_axis(lg_rng *rng) {
    enum { ROWS = 2500, STEPS = 50 };
    const double h = every / STEPS, phase = lg_rng_uniform_in(rng, 0, 6);
    double x = 0, v = 0;
    FILE *file = fopen(cli_at("axis.csv"), "w");
    assert_non_null(file);
    (void)fprintf(file, "t,q,force\n");
    for (int k = 0; k < ROWS; k++) {
        const double t = k * every, a = 1.3 * t + phase, b = 3.1 * t + 2 * phase;
        const double u =
            3e4 * (0.1 * sin(a) + 0.05 * sin(b) - x) + 2e3 * (0.13 * cos(a) + 0.155 * cos(b) - v);
        (void)fprintf(file, "%.9g,%.9g,%.9g\n", t, x + 1e-6 * lg_rng_normal(rng), u);
        for (int i = 0; i < STEPS; i++) {
            v += h * (u - 200 * v - 20 * tanh(v / 1e-4) + 3.2) / 95;
            x += h * v;
        }
    }
    assert_int_equal(fclose(file), 0);
}

TEST(
    "of an axis that lacks Coulomb friction and an offset, neither of which explains the log alone, both are "
    "found, and no network") {
    cli_write("axis.yaml",
              "columns: {time: t}\ncoordinates: [{name: q, kind: line}]\n"
              "inputs: {columns: [force]}\nmeasured: positions\nmass: diagonal\ndamping: diagonal\n"
              "input_map: {kind: known, values: [[1]]}\n");
    for (uint64_t seed = 0; seed < 2; seed++) {
        lg_rng rng = test_rng(38, seed);
        write_axis(&rng);
        cli_json(identify, "fit axis.yaml axis.csv --out m.h5 --suggest - --epochs 200", "loss *");
        const char *list = json_find(result.out, "suggested");
        assert_null(strstr(test_text("%.*s", (int)strcspn(list, "]"), list), "network"));
        const char *numbers = json_find(result.out, "identified");
        assert_close(json_number(json_find(numbers, "coulomb.q"), "value"), 20, 0.02, 0);
        assert_close(json_number(json_find(numbers, "offset.q"), "value"), 3.2, 0.02, 0);
    }
}

static int setup(void **state) {
    (void)state;
    return cli_begin();
}

TEST_GROUP(setup, cli_end)
