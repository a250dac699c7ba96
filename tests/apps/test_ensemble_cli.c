/* Runs lg-simulate --ensemble and merge: distributions, statistics with known values, parts of an ensemble
 * compared with the whole, trajectories. What they refuse is in test_refused.
 * ctest-labels: apps/lg-simulate src/mechanics */
#include "cli_support.h"

#include <hdf5.h>
#include <sys/resource.h>

#include "liegrad/files.h"

static const char lg[] = "lg-simulate";

static const char circles[] =
    "system: oscillator\ninitial: {q: 1, p: 0}\nensemble: q = normal 0 2, p = normal 0 2\nt_end: 3\n";
static const char pendulums[] = "system: pendulum-chain\ngravity: 9.81\nmasses: [1]\nlengths: [1]\n"
                                "initial: {q: [[1, 0, 0]], omega: [[0, 1, 0]]}\nt_end: 1\n";
static const char top[] = "system: heavy-top\nform: direct\ninitial: {pi: [0.1, 0.2, 0.3]}\nt_end: 0.2\n";

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("circles.yaml", circles);
    cli_write("pendulums.yaml", pendulums);
    cli_write("top.yaml", top);
    return 0;
}

static void json(const char *arguments, const char *members) {
    cli_json(lg, arguments, members);
}

static const char *within(const char *object, const char *key) {
    const char *found = json_find(object, key);
    if (found == NULL) fail_msg("no '%s' in %.300s", key, object);
    return found;
}

static double at_end(const char *column, const char *what) {
    return json_number(within(within(result.out, "end"), column), what);
}

/* ---- distributions of starts and parameters ---- */

TEST("distributions have their means and deviations") {
    enum { N = 20000 };
    json("circles.yaml --ensemble 20000 --points 2 --method dp85",
         "members 20000, total 20000, failed 0, lanes >0");
    assert_close(at_end("q", "mean"), 0, 0, 4 * 2 / sqrt(N));
    assert_close(at_end("q", "deviation"), 2, 0.03, 0);
    assert_close(at_end("energy", "mean"), 4, 0.04, 0);
    assert_close(at_end("q", "median"), 0, 0, 0.1);
    assert_close(at_end("q", "q95"), 1.6449 * 2, 0.03, 0);
    assert_true(at_end("drift of energy", "largest") < 1e-7);
    json("circles.yaml --ensemble 20000 --points 2 --vary q=uniform:2:4,p=uniform:0:0 --t-end "
         "6.283185307179586",
         "");
    assert_close(at_end("q", "mean"), 3, 0.01, 0);
    assert_close(at_end("q", "deviation"), 2 / sqrt(12), 0.02, 0);
    assert_true(at_end("q", "least") >= 2 - 1e-6 && at_end("q", "largest") <= 4 + 1e-6);
    json("circles.yaml --ensemble 20000 --points 2 --vary q=within:10%,p=around:0.5 --t-end "
         "6.283185307179586",
         "");
    assert_close(at_end("q", "deviation"), 0.1 / sqrt(3), 0.02, 0);
    assert_close(at_end("p", "deviation"), 0.5, 0.02, 0);
    cli_run(lg, "circles.yaml --ensemble 2 --vary q=within:0");
}

TEST("directions, cones and rotations have the distributions that were asked for") {
    json("pendulums.yaml --ensemble 20000 --times 0 --t-end 1e-3 --vary q=sphere,omega=normal:0:1",
         "failed 0");
    assert_close(at_end("q1.z", "mean"), 0, 0, 0.02);
    assert_close(at_end("q1.x", "deviation"), 1 / sqrt(3), 0.02, 0);
    json("pendulums.yaml --ensemble 5000 --points 2 --t-end 1e-6 --vary q1=cone:0.1", "failed 0");
    assert_true(at_end("q1.x", "least") >= cos(0.1) - 1e-6 && at_end("q1.x", "least") < cos(0.099));
    assert_close(at_end("q1.x", "mean"), (1 + cos(0.1)) / 2, 1e-4, 0);
    json("top.yaml --ensemble 5000 --points 2 --t-end 1e-6 --vary Q=rotation", "failed 0");
    assert_close(at_end("Q.11", "deviation"), 1 / sqrt(3), 0.05, 0);
    assert_close(at_end("Q.23", "mean"), 0, 0, 0.04);
}

TEST("parameters vary for each member; a member whose parameter is not allowed fails and is listed") {
    json("pendulums.yaml --ensemble 4000 --points 3 --vary gravity=uniform:9:10,L1=within:5%", "failed 0");
    assert_true(at_end("drift of energy", "largest") < 1e-6);
    assert_true(at_end("q1.z", "deviation") > 1e-3);
    json("pendulums.yaml --ensemble 4000 --points 3 --vary m1=normal:0.2:0.1", "failed >10");
    assert_close(json_number(result.out, "failed"), 4000 * 0.02275, 0.3, 0);
    assert_close(json_number(within(result.out, "failed_by_status"), "INVALID_ARGUMENT"),
                 json_number(result.out, "failed"), 0, 0);
    assert_says(result.err, "members failed");
}

TEST("members that leave the manifold or change their energy are counted, and the wrong parameter is named") {
    cli_write("fast.yaml", "system: heavy-top\nt_end: 1\ninertia: [0.234375, 0.46875, 0.234375]\nmass: 15\n"
                           "length: 2\nchi: [0, 1, 0]\ngamma0: [0, 0, -9.81]\n"
                           "initial: {Q: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], pi: [0, 70.3125, -1.08]}\n");
    json("fast.yaml --ensemble 20 --method rk4 --steps 100 --vary inertia=around:1%", "");
    assert_says(result.err, "of 20 members 20 leave the manifold, and 0 change their energy");
    json("fast.yaml --ensemble 20 --method cf4 --steps 1000 --vary inertia=around:1%", "warnings []");
    json("circles.yaml --ensemble 20 --method rk4 --steps 100 --t-end 300", "");
    assert_says(result.err, "of 20 members 0 leave the manifold, and 20 change their energy");
    json("pendulums.yaml --ensemble 20 --vary m1=uniform:-1:1", "");
    assert_says(result.err, "is not allowed: masses = -0.");
    assert_says(result.err, " is not a positive number");
}

TEST("the list of failures has the lowest members in their order, whatever the number of threads") {
    long last[2] = {-1, -1};
    for (int k = 0; k < 2; k++) {
        int count = 0;
        json(test_text("pendulums.yaml --ensemble 9000 --points 2 --vary m1=normal:0.2:0.1 --threads %d",
                       1 + 2 * k),
             "failed >100");
        const char *at = strstr(result.out, "\"failures\": [");
        for (const char *end = strchr(at, ']'); (at = strstr(at, "\"member\": ")) != NULL && at < end; at++) {
            const long member = strtol(at + strlen("\"member\": "), NULL, 10);
            assert_true(member > last[k]);
            last[k] = member;
            count++;
        }
        assert_int_equal(count, 100);
    }
    assert_int_equal(last[0], last[1]);
}

TEST("each row of a table of starts is a member") {
    cli_write("starts.csv", "q1.x,q1.y,q1.z,g\n0,1,0,0\n0,0,1,1\n0,0,-1,2\n");
    json("pendulums.yaml --ensemble 3 --starts starts.csv --points 2 --t-end 1e-9", "members 3, failed 1");
    assert_says(result.out, "\"member\": 0");
    assert_says(result.err, "member 0 (row 1 of starts.csv) is not allowed: ");
    json("pendulums.yaml --ensemble 2 --starts starts.csv --points 2 --t-end 1e-9", "members 2, failed 1");
    assert_says(result.err, "starts.csv has 3 rows: only the first 2 are used");
    cli_write("good.csv", "omega1.y\n0.5\n1.5\n-2\n");
    json("pendulums.yaml --ensemble 3 --starts good.csv --points 2 --t-end 1e-9", "members 3, failed 0");
    assert_close(at_end("omega1.y", "mean"), 0, 0, 1e-6);
    assert_close(at_end("omega1.y", "least"), -2, 1e-6, 0);
}

/* ---- events ---- */

TEST("the times of first events have their known distribution") {
    json("circles.yaml --ensemble 3000 --points 2 --vary q=uniform:1:2,p=uniform:0:0 --event q=0,q>0,p<-1.5 "
         "--method dp85 --tol 1e-10",
         "");
    const char *events = within(result.out, "events"), *first = within(events, "q=0");
    assert_close(json_number(first, "mean"), 1.5707963267948966, 1e-8, 0);
    assert_close(json_number(first, "count"), 3000, 0, 0);
    assert_close(json_number(within(events, "q>0"), "count"), 0, 0, 0);
    assert_close(json_number(within(events, "p<-1.5"), "without"), 1500, 0.1, 0);
}

/* At q = 1/2 the time is acos(1/(2 q0)): its deviation is 1/sqrt(3) times that of q0. */
TEST("the times of first events have the right deviation if it is 1e-9 of the time") {
    json("circles.yaml --ensemble 1000 --points 2 --t-end 1400 --vary q=around:1e-9,p=uniform:0:0 "
         "--event q=0.5 --method dp85 --tol 1e-12",
         "");
    const char *event = within(within(result.out, "events"), "q=0.5");
    assert_close(json_number(event, "mean"), 1.0471975511965976, 1e-9, 0);
    assert_close(json_number(event, "deviation"), 1e-9 / sqrt(3), 0.1, 0);
}

/* ---- parts of an ensemble ---- */

/* Fails unless both files hold the same numbers under this name. */
static void assert_same(const char *a, const char *b, const char *name) {
    lg_file_reader *readers[2] = {NULL, NULL};
    const char *const files[] = {a, b};
    char *data[2];
    uint64_t dims[4] = {0}, count = 1;
    uint32_t rank = 0;
    for (int i = 0; i < 2; i++) {
        lg_archive_reader from;
        assert_told(lg_file_reader_create(NULL, cli_at(files[i]), NULL, NULL, &readers[i], &told));
        assert_ok(lg_file_reader_archive(readers[i], "", &from));
        assert_ok(from.shape(from.user, name, &rank, dims));
        count = 1;
        for (uint32_t k = 0; k < rank; k++) count *= dims[k];
        data[i] = lg_test_memory(count * 8);
        const bool whole =
            strstr(name, "sum") != NULL || strstr(name, "bins") != NULL || strstr(name, "count") != NULL;
        assert_ok(from.array(from.user, name, whole ? LG_ELEMENT_I64 : LG_ELEMENT_F64, rank, dims, data[i]));
    }
    if (memcmp(data[0], data[1], count * 8) != 0) fail_msg("%s and %s differ in %s", a, b, name);
    for (int i = 0; i < 2; i++) lg_file_reader_destroy(readers[i]);
}

/* Reads /trajectories of a file with HDF5 alone, through the virtual data set. */
static double *rows_of(const char *name, hsize_t dims[3]) {
    const hid_t file = H5Fopen(cli_at(name), H5F_ACC_RDONLY, H5P_DEFAULT),
                set = H5Dopen2(file, "trajectories", H5P_DEFAULT);
    const hid_t space = H5Dget_space(set);
    assert_true(file >= 0 && set >= 0);
    assert_int_equal(H5Sget_simple_extent_dims(space, dims, NULL), 3);
    double *rows = TEST_ARRAY(double, dims[0] * dims[1] * dims[2]);
    assert_true(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, rows) >= 0);
    (void)H5Sclose(space);
    (void)H5Dclose(set);
    (void)H5Fclose(file);
    return rows;
}

#define STUDY                                                                                                \
    "pendulums.yaml --ensemble 5000 --vary q=sphere,gravity=within:5% --event q1.z=0 --points 6 "            \
    "--save 2500 "

TEST("merged columns have their names, also those with bars") {
    static const char *const tasks[] = {"", "--task 0/2", "--task 1/2"};
    cli_write("spin.yaml",
              "system: rigid-body\ninertia: [1, 2, 3]\ninitial: {mu: [1, 0.1, 0.3]}\nt_end: 1\n");
    for (size_t i = 0; i < LG_COUNT(tasks); i++)
        json(test_text("spin.yaml --ensemble 40 --vary mu=around:5%% --points 3 --out spin.h5 %s", tasks[i]),
             "members *");
    json("merge merged.h5 spin.part-0-of-2.h5 spin.part-1-of-2.h5", "members 40");
    assert_non_null(json_find(json_find(result.out, "end"), "drift of |mu|^2"));
    assert_same("spin.h5", "merged.h5", "quantiles");
}

TEST("merged parts have the bits of a single process, with any number of threads") {
    static const char *const names[] = {"mean",
                                        "deviation",
                                        "least",
                                        "largest",
                                        "quantiles",
                                        "count",
                                        "event_times/mean",
                                        "event_times/quantiles",
                                        "accumulators/states/sum",
                                        "accumulators/states/bins",
                                        "accumulators/events/sum"};
    json(STUDY "--threads 1 --out whole.h5", "members 5000");
    json(STUDY "--threads 2 --task 0/3 --out part.h5", "members <5000, first 0");
    json(STUDY "--threads 1 --task 1/3 --out part.h5", "");
    json(STUDY "--threads 2 --task 2/3 --out part.h5", "");
    json("merge merged.h5 part.part-2-of-3.h5 part.part-0-of-3.h5 part.part-1-of-3.h5",
         "members 5000, total 5000");
    for (size_t i = 0; i < LG_COUNT(names); i++) assert_same("whole.h5", "merged.h5", names[i]);
    hsize_t whole[3], merged[3];
    const double *a = rows_of("whole.h5", whole), *b = rows_of("merged.h5", merged);
    assert_int_equal(whole[0], 2500);
    assert_memory_equal(whole, merged, sizeof whole);
    assert_memory_equal(a, b, whole[0] * whole[1] * whole[2] * sizeof(double));
    /* fill values of the virtual data set would be zero */
    assert_true(a[0] != 0.0 && a[2499 * whole[1] * whole[2]] != 0.0);
    cli_expect(lg, "merge merged.h5 part.part-2-of-3.h5 part.part-0-of-3.h5", 3, "are missing");
    cli_expect(lg, "merge merged.h5 part.part-0-of-3.h5 part.part-0-of-3.h5", 3, "are there twice");
    cli_expect(lg, "merge merged.h5 part.part-0-of-3.h5", 3, "are missing");
    cli_expect(lg, "merge merged.h5 foreign.h5 part.part-0-of-3.h5", 3, "foreign.h5");
    json("circles.yaml --ensemble 5000 --points 6 --task 1/3 --out other.h5", "");
    cli_expect(lg, "merge merged.h5 part.part-0-of-3.h5 other.part-1-of-3.h5 part.part-2-of-3.h5", 3,
               "other.part-1-of-3.h5: it is a part of another ensemble");
}

/* Copies a part and overwrites number `index` of a data set by `bits`. */
static void damage(const char *from, const char *to, const char *dataset, size_t index, uint64_t bits) {
    const char *source = cli_at(from);
    const char *target = cli_at(to);
    char *line = lg_test_memory(2100);
    (void)snprintf(line, 2100, "cp %s %s", source, target);
    assert_int_equal(system(line), 0);
    const hid_t file = H5Fopen(target, H5F_ACC_RDWR, H5P_DEFAULT), set = H5Dopen2(file, dataset, H5P_DEFAULT),
                space = H5Dget_space(set), type = H5Dget_type(set);
    assert_true(file >= 0 && set >= 0);
    uint64_t *all = lg_test_memory((size_t)H5Sget_simple_extent_npoints(space) * sizeof *all);
    assert_true(H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, all) >= 0);
    all[index] = bits;
    assert_true(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, all) >= 0);
    (void)H5Tclose(type);
    (void)H5Sclose(space);
    (void)H5Dclose(set);
    assert_true(H5Fclose(file) >= 0);
}

TEST("merge refuses a part whose counts, ends or sums contradict each other") {
    enum { TOTAL, FIRST, OWN, BLOCK, STEPS, POINTS = 6, COLUMNS, EVENTS, LISTED };
    static const struct {
        const char *dataset;
        size_t index;
    } places[] = {{"accumulators/numbers", TOTAL},    {"accumulators/numbers", FIRST},
                  {"accumulators/numbers", OWN},      {"accumulators/numbers", POINTS},
                  {"accumulators/numbers", COLUMNS},  {"accumulators/numbers", EVENTS},
                  {"accumulators/numbers", LISTED},   {"failures/by_status", 0},
                  {"failures/by_status", 16},         {"accumulators/states/count", 0},
                  {"accumulators/states/count", 7},   {"accumulators/states/bins", 0},
                  {"accumulators/states/bins", 100},  {"accumulators/states/sum", 0},
                  {"accumulators/states/square", 66}, {"accumulators/events/count", 0},
                  {"accumulators/events/bins", 3}};
    static const uint64_t values[] = {(uint64_t)1 << 62, ((uint64_t)1 << 63) + 1, (uint64_t)3 << 62};
    static const uint64_t ends[] = {0x7ff0000000000000u, 0x7ff8000000000000u, 0xffefffffffffffffu};
    json(STUDY "--threads 2 --task 0/2 --out odd.h5", "");
    json(STUDY "--threads 2 --task 1/2 --out odd.h5", "");
    for (size_t i = 0; i < LG_COUNT(places); i++)
        for (size_t v = 0; v < LG_COUNT(values); v++) {
            damage("odd.part-1-of-2.h5", "bad.h5", places[i].dataset, places[i].index, values[v]);
            cli_run_limited(lg, "merge --statistics-only sum.h5 odd.part-0-of-2.h5 bad.h5", 0);
            if (result.code != 3 || strstr(result.err, "bad.h5") == NULL || cli_exists("sum.h5"))
                fail_msg("%s[%zu], value %zu: %d\n%s", places[i].dataset, places[i].index, v, result.code,
                         result.err);
        }
    /* A count smaller than the sum of the bins, and one larger than it. */
    static const struct {
        const char *dataset;
        uint64_t count;
    } counts[] = {{"accumulators/states/count", 1}, {"accumulators/events/count", 2500}};
    for (size_t i = 0; i < LG_COUNT(counts); i++) {
        damage("odd.part-1-of-2.h5", "bad.h5", counts[i].dataset, 0, counts[i].count);
        cli_expect(lg, "merge --statistics-only sum.h5 odd.part-0-of-2.h5 bad.h5", 3,
                   "contradict each other");
    }
    for (size_t v = 0; v < LG_COUNT(ends); v++) {
        damage("odd.part-1-of-2.h5", "bad.h5", "accumulators/states/largest", 1, ends[v]);
        cli_expect(lg, "merge --statistics-only sum.h5 odd.part-0-of-2.h5 bad.h5", 3, "bad.h5");
    }
    damage("odd.part-1-of-2.h5", "bad.h5", "accumulators/numbers", STEPS, UINT64_MAX);
    cli_expect(lg, "merge --statistics-only sum.h5 odd.part-0-of-2.h5 bad.h5", 3, "overflow");
    damage("odd.part-1-of-2.h5", "bad.h5", "accumulators/numbers", BLOCK, 0);
    cli_expect(lg, "merge --statistics-only sum.h5 odd.part-0-of-2.h5 bad.h5", 3, "bad.h5");
}

TEST("statistics are the same with lanes and one member at a time") {
    json("circles.yaml --ensemble 300 --points 5 --tol 1e-11", "");
    const double mean = at_end("q", "mean");
    json("circles.yaml --ensemble 300 --points 5 --method midpoint --steps 1000", "lanes 1, occupancy null");
    assert_close(at_end("q", "mean"), mean, 0, 1e-4);
}

TEST("the printed table and the plot contain what they should") {
    cli_expect(lg, "circles.yaml --ensemble 100 --event q=0 --plot bands.svg", 0, "");
    assert_says(result.out, "Time of the first event");
    static char text[65536];
    assert_true(cli_exists("bands.gp"));
    (void)cli_read("bands.dat", text, sizeof text);
    assert_says(text, "=3\n=4\n=q\n=p\n=energy\n=first q=0\n");
}

/* Copies a file with another text of the same length in the place of `text`. */
static void replace(const char *from, const char *to, const char *text, const char *other) {
    static char bytes[1 << 20];
    const size_t count = cli_read(from, bytes, sizeof bytes), length = strlen(text);
    char *at = bytes;
    while (at + length <= bytes + count && memcmp(at, text, length) != 0) at++;
    assert_true(at + length <= bytes + count && strlen(other) == length && count + 1 < sizeof bytes);
    memcpy(at, other, length);
    FILE *file = fopen(cli_at(to), "w");
    assert_true(file != NULL && fwrite(bytes, 1, count, file) == count && fclose(file) == 0);
}

TEST("the plot shows names of columns from a file as they are") {
    static const char columns[] = "q1.x|q1.y|q1.z|omega1.x|omega1.y|omega1.z|energy|";
    cli_run(lg, "pendulums.yaml --ensemble 20 --points 3 --vary q=sphere --task 0/1 --out named.h5");
    for (size_t i = 0; i < CLI_NAMES; i++) {
        char names[sizeof columns];
        const int used = snprintf(names, sizeof names, "%s|b|c|d|e|f|", cli_strange_name(i));
        (void)snprintf(names + used, sizeof names - (size_t)used, "%0*d|", (int)sizeof columns - used - 2, 0);
        replace("named.part-0-of-1.h5", "strange.h5", columns, names);
        cli_run(lg, "merge --statistics-only sum.h5 strange.h5 --plot strange.svg");
        cli_shows_names("strange.svg", "<text>", i, i + 1);
        assert_int_equal(unlink(cli_at("sum.h5")), 0);
    }
}

/* ---- parts that do not belong together, parts without members ---- */

TEST("tasks of an array run side by side; the same task cannot run twice at a time") {
    const char long_run[] = "pendulums.yaml --ensemble 100000000 --vary q=sphere --save 5000 --out array.h5";
    const char *task = test_text("%s --task 0/2", long_run);
    const cli_child first = cli_start(lg, task, 0);
    cli_wait_for(".array.part-0-of-2.h5.liegrad-lock");
    cli_wait_for(".array.part-0-of-2.trajectories.h5.liegrad-lock");
    json("pendulums.yaml --ensemble 3000 --save all --task 1/2 --out array.h5", "members >0");
    json("pendulums.yaml --ensemble 3000 --save all --out array.h5", "members 3000");
    cli_expect(lg, task, 3, "array.part-0-of-2.h5: is being written by process");
    cli_expect(lg, "pendulums.yaml --ensemble 9 --out array.part-0-of-2.trajectories.h5", 3,
               "is being written by process");
    cli_interrupt(first);
}

TEST("merge locks its output") {
    json("pendulums.yaml --ensemble 9 --task 0/1 --out claimed.h5", "members 9");
    const cli_child writer = cli_start(lg, "pendulums.yaml --ensemble 100000000 --out claimed.h5", 0);
    cli_wait_for(".claimed.h5.liegrad-lock");
    cli_expect(lg, "merge claimed.h5 claimed.part-0-of-1.h5", 3, "is being written by process");
    cli_interrupt(writer);
    assert_false(cli_exists("claimed.h5"));
    cli_expect(lg, "merge claimed.part-0-of-1.h5 claimed.part-0-of-1.h5", 2, "would be replaced");
    json("merge claimed.h5 claimed.part-0-of-1.h5", "members 9");
}

#define RUNS "circles.yaml --ensemble 3000 --points 4 --out runs.h5 "

static void both_tasks(const char *more) {
    for (int i = 0; i < 2; i++) {
        json(test_text(RUNS "--task %d/2 %s", i, more), "failed 0");
    }
}

static bool has_trajectories(const char *name) {
    const hid_t file = H5Fopen(cli_at(name), H5F_ACC_RDONLY, H5P_DEFAULT);
    const bool has = H5Lexists(file, "trajectories", H5P_DEFAULT) > 0;
    (void)H5Fclose(file);
    return has;
}

#define MERGE   "merge runs.h5 runs.part-0-of-2.h5 runs.part-1-of-2.h5"
#define PATTERN MERGE " runs.part-0-of-2.trajectories.h5 runs.part-1-of-2.trajectories.h5"

TEST("trajectories are from the run whose statistics they belong to, and complete") {
    static const char second[] = "runs.part-1-of-2.trajectories.h5";
    hsize_t one[3], two[3];
    json(RUNS "--seed 2 --save 2500", "");
    const double *whole = rows_of("runs.h5", one);
    /* The file of trajectories of the other seed still exists. */
    both_tasks("--seed 1 --save all");
    both_tasks("--seed 2");
    json(MERGE, "members 3000");
    assert_false(has_trajectories("runs.h5"));
    json(PATTERN, "members 3000");
    assert_false(has_trajectories("runs.h5"));
    assert_says(result.err, "belong to none of the given parts");
    json(RUNS "--seed 2 --save 2500 --task 0/2", "");
    cli_expect(lg, MERGE, 3, "keeps the trajectories of 2500 members of the ensemble");
    both_tasks("--seed 2 --save 2500");
    json(PATTERN, "members 3000, warnings []");
    const double *merged = rows_of("runs.h5", two);
    assert_memory_equal(one, two, sizeof one);
    assert_memory_equal(whole, merged, one[0] * one[1] * one[2] * sizeof(double));
    /* Each of these must be refused: a file of another seed, of other members, and no file. */
    char path[2][1024];
    cli_path(second, path[0], sizeof path[0]);
    cli_path("kept.h5", path[1], sizeof path[1]);
    assert_int_equal(rename(path[0], path[1]), 0);
    cli_expect(lg, MERGE, 3, "runs.part-1-of-2.trajectories.h5: is missing");
    json("circles.yaml --ensemble 3000 --points 4 --seed 3 --save 2500 --out other.h5", "");
    cli_link("other.trajectories.h5", second);
    cli_expect(lg, MERGE, 3, "holds trajectories of another run");
    json("merge --statistics-only runs.h5 runs.part-0-of-2.h5 runs.part-1-of-2.h5", "members 3000");
    assert_false(has_trajectories("runs.h5"));
    cli_unlink(second);
    cli_link("runs.part-0-of-2.trajectories.h5", second);
    cli_expect(lg, MERGE, 3, "holds 1024 members from number 0 on");
    cli_unlink(second);
    cli_link("kept.h5", second);
    json(MERGE, "members 3000");
    cli_expect(lg, "merge runs.h5 runs.part-0-of-2.trajectories.h5", 2, "at least one part of an ensemble");
}

TEST("parts with other starts or limits belong to another ensemble") {
    cli_write("starts.csv", "q,p\n1,0\n2,0\n3,0\n");
    json("circles.yaml --ensemble 3 --starts starts.csv --task 0/2 --out table.h5", "members 0");
    cli_write("starts.csv", "q,p\n1,0\n2,0\n3,1\n");
    json("circles.yaml --ensemble 3 --starts starts.csv --task 1/2 --out table.h5", "members 3");
    cli_expect(lg, "merge table.h5 table.part-0-of-2.h5 table.part-1-of-2.h5", 3, "another ensemble");
}

TEST("a part without members is accepted") {
    cli_expect(lg, "circles.yaml --ensemble 10 --points 3 --save all --task 0/2 --out few.h5", 0, "");
    assert_says(
        result.out,
        "this part has no members: parts get blocks of 1024 members, and other parts have all 10 members");
    assert_null(strstr(result.out, "nan"));
    json("circles.yaml --ensemble 10 --points 3 --save all --task 1/2 --out few.h5", "members 10, first 0");
    json("merge few.h5 few.part-1-of-2.h5 few.part-0-of-2.h5", "members 10");
    hsize_t dims[3];
    (void)rows_of("few.h5", dims);
    assert_int_equal(dims[0], 10);
    json("merge few.h5 few.part-1-of-2.h5", "members 10");
    cli_expect(lg, "merge few.h5 few.part-0-of-2.h5", 3, "members 0 to 9 are missing");
}

/* ---- trajectories larger than the memory, trajectories that cannot be written ---- */

static long peak_of_children(void) {
    struct rusage used;
    assert_int_equal(getrusage(RUSAGE_CHILDREN, &used), 0);
    return used.ru_maxrss;
}

TEST("saved trajectories are not read back into memory") {
    enum { ROWS = 150000, POINTS = 21, KILOBYTES = ROWS * POINTS * 16 / 1024 };
    const char plain[] = "circles.yaml --ensemble 150000 --points 21 --method dp85 --tol 1e-3 --threads 1 ";
    const char *saving = test_text("%s --save all --task 0/1 --out large.h5", plain);
    json(plain, "");
    const long without = peak_of_children();
    json(saving, "");
    json("merge large.h5 large.part-0-of-1.h5 large.part-0-of-1.trajectories.h5", "members 150000");
    const long with = peak_of_children();
    if (with > without + KILOBYTES / 2)
        fail_msg("%ld KB where nothing is saved, %ld KB where %d KB are", without, with, KILOBYTES);
}

TEST("if trajectories cannot be written, the statistics are still written") {
    const char arguments[] = "pendulums.yaml --ensemble 400000 --vary q=sphere --points 6 --threads 1 "
                             "--save 100 --out lost.h5";
    const cli_child child = cli_start(lg, arguments, 0);
    cli_wait_for(".lost.trajectories.h5.liegrad-lock");
    const char *path = cli_at("lost.trajectories.h5");
    assert_int_equal(mkdir(path, 0700), 0);
    cli_finish(child);
    assert_int_equal(result.code, 3);
    assert_says(result.err, "lost.trajectories.h5");
    assert_says(result.err, "the statistics are in lost.h5");
    assert_says(result.out, "400000  members of the ensemble");
    assert_int_equal(cli_count_files("lost.trajectories.h5.liegrad-tmp"), 0);
    assert_false(has_trajectories("lost.h5"));
    assert_int_equal(rmdir(path), 0);
    json("merge found.h5 lost.h5", "members 400000");
}

/* ---- signals and failures ---- */

TEST("Ctrl-C ends an ensemble and leaves no file") {
    const cli_child child =
        cli_start(lg, "pendulums.yaml --ensemble 100000000 --vary q=sphere --save 100 --out gone.h5", 0);
    (void)nanosleep(&(struct timespec){0, 400000000}, NULL);
    cli_interrupt(child);
    assert_says(result.err, "stopped by Ctrl-C");
    assert_int_equal(cli_count_files("gone"), 0);
}

TEST("the message names the signal that ended the command") {
    static const struct {
        int number;
        const char *words;
    } rows[] = {{SIGTERM, "stopped by SIGTERM"}, {SIGHUP, "stopped by SIGHUP"}};
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        const cli_child child = cli_start(lg, "pendulums.yaml --ensemble 100000000 --out gone.h5", 0);
        cli_wait_for(".gone.h5.liegrad-lock");
        assert_int_equal(kill(child.pid, rows[i].number), 0);
        cli_finish(child);
        assert_int_equal(result.code, 128 + rows[i].number);
        assert_says(result.err, rows[i].words);
    }
}

TEST("an ensemble whose members all failed ends with an error") {
    cli_expect(lg, "circles.yaml --ensemble 20 --max-steps 3 --out failed.h5", 4, "all 20 members failed");
    assert_says(result.out, "20  members failed");
    assert_true(cli_exists("failed.h5"));
    cli_expect(lg, "merge again.h5 failed.h5", 4, "all 20 members failed");
    damage("failed.h5", "bad.h5", "failures/by_status", LG_TOO_MANY_STEPS, 19);
    cli_expect(lg, "merge again.h5 bad.h5", 3, "contradict each other");
    cli_expect(lg, "pendulums.yaml --ensemble 20 --vary m1=uniform:-2:-1", 2, "all 20 members failed");
}

TEST_GROUP(setup, cli_end)
