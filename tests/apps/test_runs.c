/* What all programs that train have in common: help, equal bits for equal seeds, Ctrl-C, resumption,
 * searches, full disks.
 * ctest-labels: apps/common src/settings */
#include "cli_support.h"

#include "liegrad/model.h"

/* The data are NAME.h5, other data NAME-2.h5. */
static const struct trainer {
    const char *program, *name, *generate, *generate_other, *options;
    /* JSON members that the resumed run must print; its options come from the checkpoint */
    const char *resumed;
    const char *not_resumed; /* options that a resumed run refuses */
} trainers[] = {
    {"lg-hamiltonian", "chain", "generate scene.yaml --trajectories 40 --points 4 --t-end 0.1 --seed 5",
     "generate scene.yaml --trajectories 6 --points 8 --t-end 1 --seed 6", "--hidden 12,12 --batch 16",
     "epochs 6", "--batch=10"},
    {"lg-elastica", "beam", "generate --case both-ends --count 40 --intervals 10",
     "generate --case right-end --count 40 --intervals 10",
     "--method adam --modes 0 --hidden 12 --layers 1 --batch 8 --shards 4", "epochs 6, preset null",
     "--batch=10 --hidden=13 --gamma=1 --train-fraction=0.5"},
    {"lg-anomaly", "riser", "generate --runs 16 --hours 0.1 --noise 1 --window 30",
     "generate --runs 4 --hours 0.1 --noise 1 --window 30 --seed 9", "--batch 20 --plane 3 --split run",
     "epochs 6, split \"run\", plane 3", "--batch=10 --plane=2 --split=group --validation=0.3"},
};

static const char scene[] = "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n";
static const char start[] =
    "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
    "initial: { q: [[0.6, 0, 0.8]], p: [[0, 0.5, 0]] }\nt_end: 2\n";

static int setup(void **state) {
    if (cli_begin() != 0) return -1;
    cli_write("scene.yaml", scene);
    cli_write("start.yaml", start);
    for (const struct trainer *t = trainers; t < trainers + LG_COUNT(trainers); t++) {
        cli_run(t->program, "%s --out %s.h5", t->generate, t->name);
        cli_run(t->program, "%s --out %s-2.h5", t->generate_other, t->name);
        cli_run(t->program, "train %s.h5 %s --epochs 1 --out %s-model.h5", t->name, t->options, t->name);
    }
    return 0;
}

TEST("every command has help, every program prints its version") {
    static const struct {
        const char *program, *commands, *words;
    } rows[] = {
        {"lg-hamiltonian", "generate train evaluate predict search study demo", "Commands:"},
        {"lg-elastica", "solve generate train evaluate predict search", "Commands:"},
        {"lg-anomaly", "generate feed train evaluate search watch", "Commands:"},
        {"lg-identify", "check fit evaluate predict generate demo", "Commands:"},
        {"lg-simulate", "", "--work-precision"},
        {"lg-export", "", "NAME_step"},
    };
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        char list[128], words[64], *save = NULL;
        (void)snprintf(words, sizeof words, "%s (liegrad) ", rows[i].program);
        cli_expect(rows[i].program, "--version", 0, words);
        (void)snprintf(list, sizeof list, "%s --version", rows[i].program + strlen("lg-"));
        cli_expect("liegrad", list, 0, words);
        cli_expect(rows[i].program, "--help", 0, rows[i].words);
        (void)snprintf(words, sizeof words, "Usage: %s", rows[i].program);
        (void)snprintf(list, sizeof list, "%s", rows[i].commands);
        for (char *command = strtok_r(list, " ", &save); command != NULL;
             command = strtok_r(NULL, " ", &save)) {
            cli_run(rows[i].program, "%s --help", command);
            assert_says(result.out, words);
            assert_says(result.out, "--threads");
            cli_run(rows[i].program, "%s --version", command);
            assert_says(result.out, "(liegrad)");
        }
    }
}

/* ---- training ---- */

static void load(const char *name, lg_model_file *file, const double **theta, size_t *count) {
    assert_ok(lg_model_load(NULL, cli_at(name), NULL, file, NULL));
    *count = lg_model_parameters(file->model);
    lg_slice_info slice;
    assert_true(lg_model_file_slice(file, 0, &slice, theta)); /* the first slice: theta begins there */
}

static void expect_weights(const char *a, const char *b, bool same) {
    lg_model_file files[2];
    const double *theta[2];
    size_t count[2];
    load(a, &files[0], &theta[0], &count[0]);
    load(b, &files[1], &theta[1], &count[1]);
    assert_int_equal(count[0], count[1]);
    const bool equal = memcmp(theta[0], theta[1], count[0] * sizeof(double)) == 0;
    if (equal != same) fail_msg("%s and %s %s", a, b, equal ? "are the same" : "differ");
    for (int i = 0; i < 2; i++) lg_model_file_destroy(&files[i]);
}

/* A resumed run must refuse each of these options, and name it in the message. */
static void expect_not_resumed(const struct trainer *t) {
    char list[256], line[256], *save = NULL;
    (void)snprintf(list, sizeof list, "%s", t->not_resumed);
    for (char *option = strtok_r(list, " ", &save); option != NULL; option = strtok_r(NULL, " ", &save)) {
        char *value = strchr(option, '=');
        *value = '\0';
        (void)snprintf(line, sizeof line, "train %s.h5 --resume c.h5 --out r.h5 %s %s", t->name, option,
                       value + 1);
        cli_expect(t->program, line, 2, strrchr(option, '-') + 1);
    }
    (void)snprintf(line, sizeof line, "train %s-2.h5 --resume c.h5 --out r.h5", t->name);
    cli_expect(t->program, line, 2, "c.h5");
    assert_false(cli_exists("r.h5"));
}

TEST("the same seed gives the same bits with any number of threads, in one run or resumed; another seed "
     "gives other bits") {
    for (const struct trainer *t = trainers; t < trainers + LG_COUNT(trainers); t++) {
        cli_forget("one.h5 two.h5 other.h5 half.h5 resumed.h5 c.h5 one.h5.checkpoint two.h5.checkpoint "
                   "other.h5.checkpoint half.h5.checkpoint");
        char line[256];
        cli_run(t->program, "train %s.h5 %s --epochs 6 --threads 1 --seed 4 --out one.h5", t->name,
                t->options);
        cli_run(t->program, "train %s.h5 %s --epochs 6 --threads 2 --seed 4 --out two.h5", t->name,
                t->options);
        cli_run(t->program, "train %s.h5 %s --epochs 6 --threads 2 --seed 5 --out other.h5", t->name,
                t->options);
        (void)snprintf(line, sizeof line,
                       "train %s.h5 %s --epochs 6 --seed 4 --stop-after 2 --checkpoint c.h5 --out half.h5",
                       t->name, t->options);
        cli_json(t->program, line, "epochs 2");
        (void)snprintf(line, sizeof line, "train %s.h5 --resume c.h5 --out resumed.h5", t->name);
        cli_json(t->program, line, t->resumed);
        expect_weights("one.h5", "two.h5", true);
        expect_weights("one.h5", "resumed.h5", true);
        expect_weights("one.h5", "other.h5", false);
        expect_not_resumed(t);
    }
}

TEST("Ctrl-C saves the state of training and leaves no model") {
    for (const struct trainer *t = trainers; t < trainers + LG_COUNT(trainers); t++) {
        cli_forget("now.h5 now.h5.checkpoint");
        char line[256];
        (void)snprintf(
            line, sizeof line,
            "train %s.h5 %s --epochs 1000000 --checkpoint-every 1 --out never.h5 --history never.csv",
            t->name, t->options);
        const cli_child child = cli_start(t->program, line, 0);
        cli_wait_for("never.h5.checkpoint");
        cli_interrupt(child);
        assert_says(result.err, "--resume never.h5.checkpoint");
        assert_false(cli_exists("never.h5"));
        assert_true(cli_exists("never.csv"));
        (void)snprintf(line, sizeof line,
                       "train %s.h5 --resume never.h5.checkpoint --stop-after 1 --out now.h5", t->name);
        cli_json(t->program, line, "epochs >0");
        cli_unlink("never.h5.checkpoint");
        cli_unlink("never.csv");
    }
}

/* ---- searches ---- */

static const struct searcher {
    const char *program, *name, *ranges, *best, *published;
} searchers[] = {
    {"lg-elastica", "beam",
     "fixed: {network: discrete, batch: 16, epochs: 6, mirror: true}\nranges:\n  architecture: {choice: "
     "[mlp, "
     "resnet]}\n  layers: {integer: [0, 2]}\n  hidden: {integer: [4, 12]}\n  gamma: {uniform: [0, 1e-2]}\n"
     "  lr: {log-uniform: [1e-4, 1e-1]}\n",
     "lg-elastica train beam.h5", "elastica-discrete elastica-continuous elastica-angle"},
    {"lg-hamiltonian", "chain",
     "fixed: {epochs: 6, preset: thesis}\nranges:\n  hidden: {integer: [4, 12]}\n  lr: {log-uniform: [1e-4, "
     "1e-1]}\n",
     "lg-hamiltonian train chain.h5 --epochs 6", ""},
    {"lg-anomaly", "riser",
     "fixed: {epochs: 6, batch: 10, preset: thesis}\nranges:\n  activation: {choice: [tanh, swish]}\n"
     "  lr: {log-uniform: [1e-4, 1e-1]}\n  plane: {integer: [0, 3]}\n",
     "lg-anomaly train riser.h5 --epochs 6", "anomaly anomaly-wide"},
};

/* Reads a table of trials without its column of seconds, which differs from run to run. */
static char *read_trials(const char *name) {
    enum { SIZE = 65536 };
    char *text = lg_test_memory(SIZE), *out = text;
    int column = 0;
    (void)cli_read(name, text, SIZE);
    for (const char *s = text; *s != '\0'; s++) {
        column = *s == '\n' ? 0 : column + (*s == ',');
        if (column != 5) *out++ = *s;
    }
    *out = '\0';
    return text;
}

/* Writes a table anew as spreadsheets do, with a byte order mark and CRLF. */
static void write_as_a_spreadsheet(const char *name) {
    enum { SIZE = 1 << 16 };
    static char text[SIZE], made[2 * SIZE] = "\xef\xbb\xbf";
    char *out = made + 3;
    (void)cli_read(name, text, SIZE);
    for (const char *s = text; *s != '\0'; s++) {
        if (*s == '\n') *out++ = '\r';
        *out++ = *s;
    }
    *out = '\0';
    cli_write(name, made);
}

TEST("a search continues where it was stopped, with any number of threads, and only with the same "
     "settings") {
    for (const struct searcher *s = searchers; s < searchers + LG_COUNT(searchers); s++) {
        char line[1024], again[512];
        cli_write("ranges.yaml", s->ranges);
        cli_forget("once.csv again.csv");
        (void)snprintf(line, sizeof line,
                       "search ranges.yaml %s.h5 --rungs 5,2 --trials 6 --out once.csv --plot s.svg",
                       s->name);
        cli_json(s->program, line, "trials 6, new 6, best {");
        const char *best = json_find(result.out, "best");
        json_expect(best, "objective >0, objective <10");
        assert_non_null(json_find(json_find(best, "values"), "lr"));
        assert_true(cli_exists("s.gp"));
        cli_run(s->program, "search ranges.yaml %s.h5 --rungs 5,2 --trials 3 --out again.csv --threads 1",
                s->name);
        (void)snprintf(again, sizeof again,
                       "search ranges.yaml %s.h5 --rungs 5,2 --trials 6 --out again.csv --resume", s->name);
        write_as_a_spreadsheet("again.csv");
        cli_run(s->program, "%s --threads 2 --json", again);
        json_expect(result.out, "new 3");
        assert_string_equal(read_trials("once.csv"), read_trials("again.csv"));
        cli_run(s->program, "%s", again);
        assert_says(result.out, "best: trial");
        assert_says(result.out, s->best);
        cli_json(s->program, again, "new 0");
        static const char *const others[][2] = {{"--seed 2", "seed"}, {"--rungs 5,5,0.3", "settings"}};
        for (size_t i = 0; i < LG_COUNT(others); i++) {
            (void)snprintf(line, sizeof line, "%s %s", again, others[i][0]);
            cli_expect(s->program, line, 2, others[i][1]);
        }
        (void)snprintf(line, sizeof line,
                       "search ranges.yaml %s-2.h5 --rungs 5,2 --trials 6 --resume --out again.csv", s->name);
        cli_expect(s->program, line, 2, "data");
        (void)snprintf(line, sizeof line, "search ranges.yaml %s-model.h5 --trials 2 --out few.csv", s->name);
        cli_expect(s->program, line, 3, "-model.h5");
        cli_run(s->program, "search ranges.yaml %s.h5 --trials 2 --out new-%s.csv --resume --json", s->name,
                s->name);
        json_expect(result.out, "new 2");
        cli_unlink("again.csv");
    }
}

/* The names and values must be ones that train accepts. This is checked before the data are read. */
TEST("the searches that the project ships can be read") {
    for (const struct searcher *s = searchers; s < searchers + LG_COUNT(searchers); s++) {
        char names[128], line[2048], words[64], *save = NULL;
        (void)snprintf(words, sizeof words, "%s search: empty.h5", s->program);
        (void)snprintf(names, sizeof names, "%s", s->published);
        for (char *name = strtok_r(names, " ", &save); name != NULL; name = strtok_r(NULL, " ", &save)) {
            (void)snprintf(line, sizeof line, "search %s/../searches/%s.yaml empty.h5 --out s.csv",
                           LG_TEST_DIR, name);
            cli_expect(s->program, line, 3, words);
        }
    }
}

/* The finished trials must be the same as in a search with that number of trials. */
TEST("Ctrl-C keeps the table of a search") {
    cli_write("ranges.yaml", searchers[0].ranges);
    const cli_child child =
        cli_start("lg-elastica", "search ranges.yaml beam.h5 --trials 100000 --rungs 5,2 --out long.csv", 0);
    cli_wait_for("long.csv");
    cli_interrupt(child);
    assert_says(result.err, "continue with --continue");
    const char *finished = read_trials("long.csv");
    int trials = -2;
    for (const char *s = finished; *s != '\0'; s++) trials += *s == '\n';
    cli_run("lg-elastica", "search ranges.yaml beam.h5 --trials %d --rungs 5,2 --out short.csv", trials);
    assert_string_equal(finished, read_trials("short.csv"));
}

/* ---- the same command line again with --resume ---- */

static const struct {
    const char *program, *command, *options;
} lines[] = {
    {"lg-hamiltonian", "train chain.h5", "--preset thesis --epochs 3 --hidden 12,12"},
    {"lg-hamiltonian", "train chain.h5", "--preset best --epochs 3 --hidden 5,5 --seed 7"},
    {"lg-hamiltonian", "train chain.h5",
     "--preset best --epochs 3 --method adam --batch 16 --validation 0.2"},
    {"lg-hamiltonian", "train chain.h5", "--size 8,8 --epochs 3 --integrator rk4 --substeps 2 --shards 2"},
    {"lg-hamiltonian", "train chain.h5",
     "--epochs 3 --hidden 6 --penalty 0.1 --activation tanh --potential mlp"},
    {"lg-elastica", "train beam.h5", "--preset thesis --epochs 3 --network discrete --hidden 9"},
    {"lg-elastica", "train beam.h5", "--preset best --epochs 3 --network continuous"},
    {"lg-elastica", "train beam.h5", "--preset best --epochs 3 --network angle --method adam"},
    {"lg-elastica", "train beam.h5", "--preset best --size auto --seconds 4"},
    {"lg-anomaly", "train riser.h5", "--preset thesis --epochs 3 --batch 20 --plane 3 --split run"},
    {"lg-anomaly", "train riser.h5", "--preset best --epochs 3 --batch 20 --plane 3 --history l.csv"},
    {"lg-fit", "train table.csv", "--epochs 5 --outputs y"},
    {"lg-fit", "train table.csv", "--epochs 5 --size auto --outputs y"},
    {"lg-fit", "train table.csv", "--epochs 5 --method adam:2,lbfgs --hidden 6 --validation 0.2"},
    {"lg-identify", "fit machine.yaml table.csv", "--epochs 5"},
    {"lg-identify", "fit machine.yaml table.csv", "--epochs 5 --method adam --window 6 --stride 2 --seed 3"},
};

static void write_table(void) {
    char text[8192] = "t,a,b,y\n";
    size_t used = strlen(text);
    for (int i = 0; i < 120; i++)
        used += (size_t)snprintf(text + used, sizeof text - used, "%d,%.6f,%.6f,%.6f\n", i, sin(i * 1.7),
                                 cos(i * 2.9), sin(2 * sin(i * 1.7)) * cos(i * 2.9));
    cli_write("table.csv", text);
    cli_write("machine.yaml", "columns: {time: t}\ncoordinates: [{name: a, kind: line, velocity: b}]\n"
                              "mass: diagonal\npotential: {kind: quadratic, of: a}\n");
}

TEST("the command line of a training continues it if --resume is added") {
    write_table();
    for (size_t i = 0; i < LG_COUNT(lines); i++) {
        cli_run(lines[i].program, "%s %s --stop-after 1 --out again.h5", lines[i].command, lines[i].options);
        if (!cli_exists("again.h5.checkpoint")) fail_msg("row %zu: has no checkpoint", i);
        cli_expect(lines[i].program,
                   test_text("%s %s --stop-after 1 --out again.h5 --resume again.h5.checkpoint",
                             lines[i].command, lines[i].options),
                   0, "");
        cli_unlink("again.h5.checkpoint");
        if (cli_exists("again.h5")) cli_unlink("again.h5");
    }
}

TEST("training with a preset is resumed with the stored preset, and gives the bits of one run") {
    for (size_t i = 0; i < 2; i++) {
        const char *preset = i == 0 ? "thesis" : "best";
        char line[256];
        cli_forget(
            "one.h5 resumed.h5 one.h5.checkpoint resumed.h5.checkpoint half.h5 half.h5.checkpoint c.h5");
        cli_run("lg-hamiltonian", "train chain.h5 --preset %s --epochs 4 --hidden 9,9 --out one.h5", preset);
        cli_run("lg-hamiltonian",
                "train chain.h5 --preset %s --epochs 4 --hidden 9,9 --stop-after 2 --out p.h5", preset);
        (void)snprintf(
            line, sizeof line,
            "train chain.h5 --preset %s --epochs 4 --hidden 9,9 --out q.h5 --resume p.h5.checkpoint",
            i == 0 ? "best" : "thesis");
        cli_expect("lg-hamiltonian", line, 2, "p.h5.checkpoint: was written with");
        cli_run(
            "lg-hamiltonian",
            "train chain.h5 --preset %s --epochs 4 --hidden 9,9 --out resumed.h5 --resume p.h5.checkpoint",
            preset);
        expect_weights("one.h5", "resumed.h5", true);
    }
}

/* ---- full disks ---- */

TEST("a full disk is reported with the file's name, and no file is left") {
    static const struct {
        const char *program, *line;
        rlim_t limit;
        const char *words;
    } rows[] = {
        {"lg-hamiltonian", "generate scene.yaml --out full.h5 --trajectories 300", 4096, "full.h5"},
        {"lg-hamiltonian", "train chain.h5 --epochs 1 --out full.h5", 2048, "full.h5"},
        {"lg-hamiltonian", "train chain.h5 --epochs 9 --out full.h5 --stop-after 1", 2048,
         "full.h5.checkpoint"},
        {"lg-hamiltonian", "predict chain-model.h5 start.yaml --points 500 --out full.h5", 2048, "full.h5"},
        {"lg-hamiltonian", "train chain.h5 --batch 8 --epochs 60 --out m.h5 --history full.csv", 512,
         "full.csv"},
        /* There is room for the plot's data, but not for the plot. */
        {"lg-hamiltonian", "evaluate chain-model.h5 chain-2.h5 --plot full.svg", 8192, "full.svg"},
        {"lg-elastica", "generate --count 100 --out full.h5", 4096, "full.h5"},
        {"lg-elastica", "train beam.h5 --hidden 12 --epochs 1 --out full.h5", 2048, "full.h5"},
        {"lg-elastica", "train beam.h5 --hidden 12 --epochs 9 --out full.h5 --stop-after 1", 2048,
         "full.h5.checkpoint"},
        {"lg-elastica", "predict beam-model.h5 --x 1 --points 500 --out full.csv", 2048, "full.csv"},
        {"lg-elastica", "solve --x 1 --intervals 500 --out full.csv", 2048, "full.csv"},
        {"lg-elastica", "search ranges.yaml beam.h5 --trials 6 --rungs 5,2 --out full.csv", 200, "full.csv"},
        /* There is no room for the data, then not for the script, then not for the plot. */
        {"lg-elastica", "solve --x 1 --intervals 500 --plot full.svg", 2048, "full.dat"},
        {"lg-elastica", "solve --sweep 3 --intervals 4 --plot full.svg", 1024, "full.gp"},
        {"lg-elastica", "solve --x 1 --intervals 20 --plot full.svg", 16384, "full.svg"},
        {"lg-anomaly", "generate --runs 2 --hours 0.05 --out full.h5", 4096, "full.h5"},
        {"lg-anomaly", "train riser.h5 --epochs 1 --out full.h5", 2048, "full.h5"},
        {"lg-anomaly", "train riser.h5 --method tree --out full.h5", 2048, "full.h5"},
        {"lg-anomaly", "feed --hours 0.02 --out full.csv", 2048, "full.csv"},
        {"lg-anomaly", "evaluate riser-model.h5 riser.h5 --scores full.csv", 200, "full.csv"},
        {"lg-simulate", "start.yaml --out full.h5", 4096, "full.h5"},
        {"lg-simulate", "start.yaml --plot full.svg", 4096, "full"},
    };
    cli_write("ranges.yaml", searchers[0].ranges);
    const int before = cli_count_files("");
    for (size_t i = 0; i < LG_COUNT(rows); i++) {
        cli_run_limited(rows[i].program, rows[i].line, rows[i].limit);
        /* Without gnuplot there is no plot to write; then the row is replaced by one that fails. */
        if (result.code == 0 && strstr(rows[i].line, "--plot") != NULL &&
            strstr(result.err, "gnuplot") != NULL)
            cli_run_limited("lg-elastica", "solve --x 1 --intervals 500 --plot full.svg", 2048);
        else if (strstr(result.err, rows[i].words) == NULL)
            fail_msg("%s: '%s' is not in %s", rows[i].line, rows[i].words, result.err);
        if (result.code != 3) fail_msg("%s: exit code %d: %s", rows[i].line, result.code, result.err);
        if (cli_count_files("full") + cli_count_files("tmp") > 0)
            fail_msg("%s: a file is left", rows[i].line);
    }
    assert_int_equal(cli_count_files(""), before);
}

TEST_GROUP(setup, cli_end)
