/* Command lines that executables must refuse: exit code, a message that begins with the program's name and
 * contains the given words, nothing on standard output, no new file. Then files whose text is wrong, each
 * with the command that reads it.
 * ctest-labels: apps/common src/settings */
#include "cli_support.h"

#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/integrators.h"
#include "liegrad/series.h"

#include <hdf5.h>

/* A line may have words in braces; the line is run with each of these words, which also replaces % in
 * `words`. A word `--option=x` becomes `--option x` in the line and `x` in `words`. If `words` is NULL, the
 * message must contain `--option: 'x'`. */
typedef struct refusal {
    const char *line;
    int code;
    const char *words;
} refusal;

static void run(const char *program, const char *const *lines, size_t count) {
    for (size_t i = 0; i < count; i++) cli_expect(program, lines[i], 0, "");
}
#define RUN(program, ...)                                                                                    \
    run(program, (const char *const[]){__VA_ARGS__}, LG_COUNT(((const char *const[]){__VA_ARGS__})))

/* Overwrites one number of a data set. */
static void spoil(const char *name, const char *set_name, size_t index, double value) {
    static double data[16384];
    const hid_t file = H5Fopen(cli_at(name), H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t set = H5Dopen2(file, set_name, H5P_DEFAULT);
    assert_true(H5Dget_storage_size(set) <= sizeof data);
    assert_true(H5Dread(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    data[index] = value;
    assert_true(H5Dwrite(set, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0);
    assert_true(H5Dclose(set) >= 0 && H5Fclose(file) >= 0);
}

/* Makes a file that has only its kind. */
static void make_kind(const char *name, const char *kind) {
    lg_file_writer *writer;
    assert_ok(lg_file_writer_create(NULL, cli_at(name), kind, NULL, &writer, NULL));
    assert_ok(lg_file_writer_commit(writer, NULL));
    lg_file_writer_destroy(writer);
}

/* Copies `text` to `out` with the bytes from..to-1 replaced by `with`. */
static void replace(const char *text, size_t from, size_t to, const char *with, char *out, size_t size) {
    (void)snprintf(out, size, "%.*s%s%s", (int)from, text, with, text + to);
}

/* Runs the row with `word` in place of its braces, which are the bytes from..to-1 of its line. */
static void refuse(const char *program, const refusal *row, size_t from, size_t to, const char *word) {
    char line[1024], words[256], argument[128];
    const size_t equals = strncmp(word, "--", 2) == 0 ? strcspn(word, "=") : 0;
    const char *value = word + equals + (word[equals] == '=');
    replace(word, equals, equals + (word[equals] == '='), equals > 0 ? " " : "", argument, sizeof argument);
    replace(row->line, from, to, argument, line, sizeof line);
    if (row->words == NULL)
        (void)snprintf(words, sizeof words, "%.*s: '%s'", (int)equals, word, value);
    else {
        const size_t place = strcspn(row->words, "%");
        replace(row->words, place, place + (row->words[place] == '%'), row->words[place] == '%' ? value : "",
                words, sizeof words);
    }
    cli_expect(program, line, row->code, words);
    if (strncmp(result.err, program, strlen(program)) != 0)
        fail_msg("%s: the message does not begin with the program: %s", line, result.err);
    assert_string_equal(result.out, "");
}

static void refuse_row(const char *program, const refusal *row) {
    const size_t from = strcspn(row->line, "{"), to = strcspn(row->line, "}");
    char list[512], *save = NULL;
    if (row->line[from] == '\0') {
        refuse(program, row, from, from, "");
        return;
    }
    (void)snprintf(list, sizeof list, "%.*s", (int)(to - from - 1), row->line + from + 1);
    for (char *word = strtok_r(list, " ", &save); word != NULL; word = strtok_r(NULL, " ", &save))
        refuse(program, row, from, to + 1, word);
}

/* Runs all rows. The folder must have as many files as before. */
static void refuse_all(const char *program, const refusal *rows, size_t count) {
    const int before = cli_count_files("");
    for (size_t i = 0; i < count; i++) refuse_row(program, &rows[i]);
    assert_int_equal(cli_count_files(""), before);
}
#define REFUSE(program, rows) refuse_all(program, rows, LG_COUNT(rows))

/* For each row: `line` must end with code 3 when bad.yaml has the first text; the message must contain the
 * file's name and the second text. */
static void refuse_texts(const char *program, const char *line, const char *const (*rows)[2], size_t count) {
    for (size_t i = 0; i < count; i++) {
        cli_write("bad.yaml", rows[i][0]);
        refuse_row(program, &(refusal){line, 3, rows[i][1]});
        assert_non_null(strstr(result.err, "bad.yaml"));
    }
}

/* ---- lg-hamiltonian ---- */

#define TRAIN "train train.h5 --out m.h5 "

static const refusal hamiltonian[] = {
    {"", 2, "a command is missing"},
    {"--json", 2, "a command is missing"},
    {"learn", 2, "'learn' is not a command"},
    {"{train generate}", 2, "missing argument"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate model.h5 test.h5 --drawn 0", 2, "--drawn"},
    {"train train.h5", 2, "--out FILE is missing"},
    {"generate scene.yaml", 2, "--out FILE is missing"},
    {"study grid.yaml", 2, "--out FILE.csv is missing"},
    {"train train.h5 test.h5 --out m.h5", 2, "too many arguments: 'test.h5'"},
    {TRAIN "{--bogus --epochs}", 2, "%"},
    {TRAIN "{--epochs=0 --lr=0 --hidden=10,,3 --threads=0 --seed=-1 --scheme=leapfrog --plot=loss.pdf}", 2,
     NULL},
    {TRAIN "--hidden 1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1", 2,
     "--hidden: a list of 20 numbers is too long; at most 15 are allowed"},
    {TRAIN "--scheme leapfrog", 2, "is not one of euler"},
    {TRAIN "--scheme stormer-verlet", 2, "stormer-verlet needs a separable"},
    {TRAIN "--scheme slgi", 2, "slgi is for SE(3)"},
    {TRAIN "--scheme rk4-projected", 2, "rk4-projected projects states onto the manifold"},
    {"--threads -2 train train.h5 --out m.h5", 2, "--threads: '-2'"},
    {TRAIN "--penalty 1e-3 --penalty-integral oscillator", 2,
     "oscillator = (q_1^2 + p_1^2)/2 of the penalty"},
    {TRAIN "{--penalty-integral=oscillator --penalty-form=text}", 2, "needs --penalty MU"},
    {TRAIN "--potential {linear dictionary} --hidden 8", 2, "--hidden: --potential % has no network"},
    {TRAIN "--potential dictionary {--activation=swish --prior=1}", 2,
     "--potential dictionary has no network"},
    {TRAIN "--optimizer {adam lm adam:2,lm} --prior 0.1", 2,
     "--prior: is for ssbroyden and lbfgs; training by %"},
    {TRAIN "--newton", 2, "--newton"},
    {TRAIN "--initial-states estimated --newton --potential linear", 2, "--newton"},
    {TRAIN "--optimizer lbfgs --lr 1e-2", 2, "--lr: is for adam"},
    {TRAIN "--size 7 --hidden 7", 2, "both set the widths"},
    {TRAIN "--size seven", 2, "--size: 'seven'"},
    {TRAIN "--potential dictionary --size 8", 2, "--size: this model has no network"},
    {"train {missing.h5 empty.h5 foreign.h5 model.h5 .} --out m.h5", 3, "%"},
    {"train nan.h5 --out m.h5", 3, "nan.h5: /trajectories: NaN at index (1, 1, 1)"},
    {"evaluate model.h5 nan.h5", 3, "NaN"},
    {"train train.h5 --out nowhere/m.h5", 3, "nowhere/m.h5"},
    {"train train.h5 --out .", 3, "folder"},
    {TRAIN "{--history=nowhere/h.csv --checkpoint=nowhere/c.h5 --resume=missing.h5 --resume=foreign.h5 "
           "--resume=model.h5}",
     3, "%"},
    {"train train.h5 --out train.h5", 2, "--out: train.h5 is an input and would be replaced"},
    {TRAIN "--history ./train.h5", 2, "--history: ./train.h5 is an input"},
    {TRAIN "--history m.h5", 2, "--history: m.h5 is also the output file of --out"},
    {TRAIN "--checkpoint m.h5", 2, "--checkpoint: m.h5 is also the output file of --out"},
    {"train train.h5 --out model.h5 --resume model.h5", 2, "--out: model.h5 is an input of --resume"},
    {"generate scene.yaml --out scene.yaml", 2, "--out: scene.yaml is an input"},
    {"predict model.h5 start.yaml --out model.h5", 2, "--out: model.h5 is an input"},
    {"predict model.h5 start.yaml --out m.gp --plot m.svg", 2,
     "--plot: m.gp is also the output file of --out"},
    {"evaluate model.h5 link.dat --plot link.svg", 2, "--plot: link.dat is an input"},
    {"study grid.yaml --out grid.yaml", 2, "--out: grid.yaml is an input"},
    {"study grid.yaml --out s.gp --plot s.svg", 2, "--plot: s.gp is also the output file of --out"},
    {"generate scene.yaml --out d.h5 {--trajectories=-5 --points=1 --t-end=-1 --noise=-0.1 "
     "--noise-kind=pink}",
     2, NULL},
    {"generate {missing.yaml train.h5} --out d.h5", 3, "%"},
    {"generate scene.yaml --out nowhere/d.h5", 3, "nowhere/d.h5"},
    {"evaluate {missing.h5 test.h5} test.h5", 3, "%"},
    {"evaluate model.h5 missing.h5", 3, "missing.h5"},
    {"evaluate model.h5 test.h5 {--tolerance=0}", 2, NULL},
    {"evaluate model.h5 {./model.h5 twin.h5} --record", 2,
     "--record: model.h5 is both the model and the test data"},
    {"evaluate nowhere/model.h5 test.h5 --record", 3, "nowhere/model.h5: cannot be written"},
    {"evaluate {missing.h5 train.h5} test.h5 --record", 3, "%"},
    {"predict model.h5", 2, "--initial"},
    {"predict model.h5 start.yaml --initial 1,2", 2, "--initial and a scene cannot be given together"},
    {"predict model.h5 --initial 1,2,3", 2, "3 numbers"},
    {"predict model.h5 {--initial=1,0,0,0,nan,0}", 2, NULL},
    {"predict model.h5 --initial 1,0,0,1,0,0", 2, "manifold"},
    {"predict model.h5 quartic.yaml", 3, "quartic.yaml"},
    {"predict model.h5 start.yaml --out nowhere/p.h5", 3, "nowhere/p.h5"},
    {"study {missing.yaml scene.yaml} --out s.csv", 3, "%"},
    {"study grid.yaml --out nowhere/s.csv", 3, "nowhere/s.csv"},
    {"study grid.yaml --out scene.yaml", 3, "not the table of a study"},
    {"study grid.yaml --out s.csv {--plot=s.jpg --jobs=0}", 2, NULL},
    {"study grid.yaml --out s.csv --plot nowhere/s.svg", 3, "nowhere/s.svg"},
    {"demo --out scene.yaml", 3, "scene.yaml"},
};

TEST("lg-hamiltonian refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("scene.yaml", "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n");
    cli_write("start.yaml",
              "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1]\nlengths: [1]\n"
              "initial: { q: [[0.6, 0, 0.8]], p: [[0, 0.5, 0]] }\nt_end: 2\n");
    cli_write("quartic.yaml", "system: quartic\n");
    cli_write("grid.yaml",
              "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\nintegrators: [cf4]\n"
              "N: [12]\nM: [3]\neps: [0]\nrepeats: 1\nt_end: 0.1\nepochs: 1\nbatch: 8\n"
              "hidden: [6]\ntest: { trajectories: 4, points: 5 }\nseed: 3\n");
    RUN("lg-hamiltonian",
        "generate scene.yaml --trajectories 40 --points 4 --t-end 0.1 --out train.h5 --seed 5",
        "generate scene.yaml --trajectories 6 --points 8 --t-end 1 --out test.h5 --seed 6",
        "generate scene.yaml --trajectories 3 --points 4 --t-end 0.1 --out nan.h5",
        "train train.h5 --hidden 12,12 --batch 16 --epochs 1 --out model.h5");
    spoil("nan.h5", "trajectories", 31, NAN); /* trajectory 1, point 1, component 1 */
    cli_link("test.h5", "link.dat");
    cli_link("model.h5", "twin.h5");
    REFUSE("lg-hamiltonian", hamiltonian);
    cli_expect("lg-hamiltonian",
               TRAIN "--hidden 30,30,30,30,30,30,30,30 --activation identity --dtype f32 --lr 1e3", 4,
               "epoch 2, batch 1: the loss");
    static const char *const scenes[][2] = {
        {"system: pendulum-chain\nmasses: [1]\nlengths: [1]\nmasses: [2]\ngravity: 1\n", "line 4"},
        {"system: [pendulum-chain\n", "bad.yaml"},
    }; /* test_scene_files has the others */
    refuse_texts("lg-hamiltonian", "generate bad.yaml --out d.h5", scenes, LG_COUNT(scenes));
}
#undef TRAIN

/* ---- lg-elastica ---- */

#define TRAIN "train data.h5 --out m.h5 "

static const refusal elastica[] = {
    {"", 2, "a command is missing"},
    {"bend", 2, "'bend' is not a command"},
    {"--bogus", 2, "--bogus"},
    {"solve", 2, "no boundary conditions: give --case and --x, or --theta0 and --thetaN"},
    {"solve extra --x 1", 2, "too many arguments: 'extra'"},
    {"solve --case both-ends", 2, "--x X is missing"},
    {"solve --case left-end --x 1", 2, "--case: 'left-end' is not one of both-ends, right-end"},
    {"solve {--x=nan --x=inf --x=1,2 --sweep=1}", 2, NULL},
    {"solve --thetaN 1 {--theta0=nan}", 2, NULL},
    {"solve --x 1 --theta0 1", 2, "--x and --theta0 cannot be given together"},
    {"solve --theta0 1", 2, "--thetaN B is missing"},
    {"solve --thetaN 1", 2, "--thetaN: needs --theta0 A"},
    {"solve --theta0 1 --thetaN -1 --rotation 1", 2,
     "the nearest rotations that do are -2 and 4.28318530718"},
    {"solve --theta0 1 --thetaN -1 --rotation -2.000001", 2, "the nearest rotations that do are -2 and"},
    {"solve --x 1 {--intervals=1 --intervals=50.5 --length=0 --stiffness=-1 --gradient-tol=0 --qN=1,nan}", 2,
     NULL},
    {"solve --x 1 {--length=2.9 --length=3}", 2, "the ends are 3 apart"},
    {"solve --sweep 3 --length 2", 2, "the ends are 3 apart"},
    {"solve --x 1 --qN 5,0", 2, "the ends are 5 apart"},
    {"solve --x 1 --q0 1", 2, "--q0: a list of 1 numbers is too short; at least 2 are needed"},
    {"solve --x 1 --qN 1,2,3", 2, "--qN: a list of 3 numbers is too long; at most 2 are allowed"},
    {"solve --x 1 --branches --continuous", 2, "--continuous and --branches cannot be given together"},
    {"solve --x 1 --saddles", 2, "--saddles: needs --branches"},
    {"solve --x 1 --sweep 5", 2, "--sweep and --x cannot be given together"},
    {"solve --sweep 5 --branches", 2, "--branches and --sweep cannot be given together"},
    {"solve --x 1 --qN 1,nan", 2, "'1,nan' is not a list of numbers, separated by commas\n"},
    {"solve --x 1 --intervals 99999999", 2, "of at least 2 and at most"},
    {"solve --x 1 --stiffness 1e301", 2, "'1e301' is not a number above 0 and at most 1e+300\n"},
    {"solve --x 1 --stiffness 0", 2, "'0' is not a number above 0\n"},
    {"solve --x 1 --seed 18446744073709551616", 2, "a whole number of at least 0 and below 2^64\n"},
    {"solve --x 1 --plot {c.pdf}", 2, "%"},
    {"solve --x 1 {--plot=nowhere/c.svg --out=nowhere/c.csv}", 3, "%"},
    {"solve --x 1 --out .", 3, "folder"},
    {"solve --x 1 --out c.dat --plot c.svg", 2, "--plot: c.dat is also the output file of --out"},
    {"solve --sweep 3 --out c.gp --plot c.svg", 2, "--plot: c.gp is also the output file of --out"},
    {"generate", 2, "--out FILE is missing"},
    {"generate --out d.h5 --case neither", 2, "--case: 'neither' is not one of both-ends, right-end, both"},
    {"generate --out d.h5 {--count=0 --intervals=1 --gap=0.5 --gap=-0.1 --gap=nan --plot=d.jpg}", 2, NULL},
    {"generate --out d.h5 --length 2.5 --count 4", 2, "the ends are 3 apart"},
    {"generate --out nowhere/d.h5", 3, "nowhere/d.h5"},
    {"generate --out d.gp --plot d.svg", 2, "--plot: d.gp is also the output file of --out"},
    {"generate --out d.svg --plot nowhere/../d.svg", 3, "nowhere"},
    {"generate --out d.svg --plot ./d.svg", 2, "--plot: ./d.svg is also the output file of --out"},
    {"train data.h5 --out data.h5", 2, "--out: data.h5 is an input and would be replaced"},
    {"train data.h5 --out {./data.h5 link.h5}", 2, "--out: % is an input"},
    {"train link.dat --out link.h5", 2, "--out: link.h5 is an input"},
    {TRAIN "--history link.h5", 2, "--history: link.h5 is an input"},
    {TRAIN "--history ./m.h5", 2, "--history: ./m.h5 is also the output file of --out"},
    {TRAIN "--history m.h5.checkpoint", 2, "is also the output file of --checkpoint"},
    {"train data.h5 --out m.dat --plot m.svg", 2, "--plot: m.dat is also the output file of --out"},
    {"train data.h5 --out model.h5 --resume model.h5", 2, "--out: model.h5 is an input of --resume"},
    {TRAIN "--resume {data.h5 missing.h5 model.h5}", 3, "%"},
    {TRAIN "--resume data.h5 --checkpoint data.h5", 2, "--checkpoint: data.h5 is an input"},
    {TRAIN "--modes 40", 2, "40 modes"},
    {TRAIN "--loss energy --angles false", 2, "only the discrete network of angles"},
    {TRAIN "--network angle --penalty 1", 2, "--penalty: --network angle has no such option"},
    {"evaluate model.h5 link.dat --plot link.svg", 2, "--plot: link.dat is an input"},
    {"predict model.h5 --x 1 --out model.h5", 2, "--out: model.h5 is an input"},
    {"predict model.h5 --x 1 --out p.gp --plot p.png", 2, "--plot: p.gp is also the output file of --out"},
    {"search ranges.yaml data.h5 --out {data.h5 ranges.yaml}", 2, "--out: % is an input"},
    {"search ranges.yaml data.h5 --out ranges.yaml --resume", 2, "--out: ranges.yaml is an input"},
    {"search ranges.yaml data.h5 --out s.dat --plot s.svg", 2,
     "--plot: s.dat is also the output file of --out"},
    {"train", 2, "missing argument"},
    {"train data.h5", 2, "--out FILE is missing"},
    {TRAIN "--network deep", 2, "--network: 'deep' is not one of discrete, continuous"},
    {TRAIN "--optimizer {lm adam:1,lm}", 2,
     "is not a method of training; the methods are adam, ssbroyden, lbfgs"},
    {TRAIN "--prior 1", 2, "unrecognized option '--prior'"},
    {TRAIN "--normalise maybe", 2, "--normalise: 'maybe' is not one of false, true"},
    {TRAIN "--boundary true", 2, "--boundary: --network discrete has no"},
    {"train both.h5 --out m.h5 --network angle --preset thesis", 2, "--preset: thesis has no settings"},
    {TRAIN "--train-fraction 0.95 --test-fraction 0.1", 2, "add up to more than 1"},
    {TRAIN "--train-fraction 0.001", 2, "leave none of 40 curves for training"},
    {TRAIN "--plot {l.pdf}", 2, "%"},
    {"train data.h5 --out nowhere/m.h5", 3, "nowhere/m.h5"},
    {TRAIN "--history nowhere/h.csv", 3, "nowhere/h.csv"},
    {"train {missing.h5 empty.h5 foreign.h5 model.h5 torn.h5} --out m.h5", 3, "%"},
    {"train nan.h5 --out m.h5", 3, "nan.h5: /q: NaN at index (1, 6, 1)"},
    {TRAIN "--resume model.h5 --preset best", 3, "model.h5: attribute kind"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate {missing.h5 data.h5} data.h5", 3, "%"},
    {"evaluate model.h5 {missing.h5 coarse.h5 long.h5}", 3, "%"},
    {"evaluate angle.h5 long.h5", 3, "long.h5"},
    {"evaluate model.h5 nan.h5", 3, "NaN"},
    {"evaluate model.h5 data.h5 {--part=half --plot=e.gif}", 2, NULL},
    {"evaluate model.h5 right.h5 --part test", 2, "was trained on other data than right.h5"},
    {"predict model.h5", 2, "no boundary conditions"},
    {"predict model.h5 {--x=nan}", 2, NULL},
    {"predict model.h5 --x 1 --s 0,4", 2, "--s: 4 is outside the beam [0, 3.3]"},
    {"predict model.h5 --x 1 --s -1,1", 2, "--s: -1 is outside"},
    {"predict model.h5 --x 1 --s 1,0.5", 2, "--s: 0.5 follows 1; arc lengths must ascend"},
    {"predict model.h5 --x 1 --s 1 --points 5", 2, "--s and --points cannot be given together"},
    {"predict model.h5 --x 1 {--points=1}", 2, NULL},
    {"predict model.h5 --x 1 --qN 9,0", 2, "the ends are 9 apart"},
    {"predict {missing.h5 data.h5} --x 1", 3, "%"},
    {"predict model.h5 --x 1 --out nowhere/p.csv", 3, "nowhere/p.csv"},
    {"search ranges.yaml data.h5", 2, "--out FILE.csv is missing"},
    {"search ranges.yaml --out s.csv", 2, "missing argument"},
    {"search {missing.yaml data.h5} data.h5 --out s.csv", 3, "%"},
    {"search ranges.yaml missing.h5 --out s.csv", 3, "missing.h5"},
    {"search ranges.yaml data.h5 --out nowhere/s.csv", 3, "nowhere/s.csv"},
    {"search ranges.yaml data.h5 --out s.csv {--trials=0 --rungs=17 --rungs=2.5 --rungs=5,5,0 "
     "--validation-fraction=1}",
     2, NULL},
};

/* Ranges of a search that train would refuse, each with the line that is wrong. */
static const char *const elastica_ranges[][2] = {
    {"fixed: {bogus: 1}\nranges:\n  layers: {integer: [0, 4]}\n",
     "line 1: 'bogus' is not an option of train"},
    {"fixed:\n  out: m.h5\nranges:\n  layers: {integer: [0, 4]}\n",
     "line 2: 'out' is not an option of train"},
    {"ranges:\n  resume: {choice: [a, b]}\n", "line 2: 'resume' is not an option of train"},
    {"ranges:\n  layers: {integer: [0, 4]}\n  width: {integer: [1, 4]}\n",
     "line 3: 'width' is not an option"},
    {"ranges:\n  layers: {integer: [0, 15]}\n", "line 2: layers: '15'"},
    {"ranges:\n  layers: {uniform: [0, 4]}\n", "line 2: layers: '1.5"},
    {"ranges:\n  lr: {uniform: [0, 1]}\n", "line 2: lr: '0'"},
    {"ranges:\n  activation: {choice: [tanh, tan]}\n", "line 2: activation: 'tan' is not one of"},
    {"fixed: {epochs: 0}\nranges:\n  layers: {integer: [0, 4]}\n", "line 1: epochs: '0'"},
    {"fixed: {lr: 1}\n", "ranges"},
    {"ranges:\n  lr: {log-uniform: [1, 1e4]}\n",
     "line 2: lr: '10000' is not a number above 0 and at most 1000"},
    {"fixed: {network: angle}\nranges:\n  gamma: {uniform: [0, 1]}\n",
     "line 3: gamma: --network angle has no such option"},
    {"fixed: {optimizer: lbfgs}\nranges:\n  lr: {uniform: [0.1, 1]}\n",
     "line 3: lr: is for adam; training by lbfgs has no such option"},
    {"fixed:\n  batch: 10\nranges:\n  optimizer: {choice: [lbfgs, ssbroyden]}\n",
     "line 2: batch: is for adam"},
};

TEST("lg-elastica refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("ranges.yaml", "fixed: {network: discrete}\nranges:\n  layers: {integer: [0, 2]}\n");
    RUN("lg-elastica", "generate --case both-ends --count 40 --intervals 10 --out data.h5",
        "generate --case right-end --count 40 --intervals 10 --out right.h5",
        "generate --case both --count 10 --intervals 10 --out both.h5",
        "generate --case both-ends --count 8 --intervals 6 --out coarse.h5",
        "generate --case both-ends --count 8 --intervals 10 --length 4 --out long.h5",
        "generate --count 6 --intervals 8 --out nan.h5", "generate --count 6 --intervals 8 --out torn.h5",
        "train data.h5 --optimizer adam --modes 0 --hidden 12 --layers 1 --batch 8 --epochs 1 --out model.h5",
        "train data.h5 --network angle --embedding 4 --hidden 4 --layers 1 --epochs 1 --out angle.h5");
    spoil("nan.h5", "q", 31, NAN);
    spoil("torn.h5", "boundary", 8, 0.25);
    cli_link("data.h5", "link.h5");
    cli_link("data.h5", "link.dat");
    REFUSE("lg-elastica", elastica);
    cli_expect("lg-elastica",
               TRAIN "--optimizer adam --dtype f32 --modes 0 --hidden 12 --layers 14 --batch 8 --lr 1e3 "
                     "--schedule constant "
                     "--activation identity --epochs 9",
               4, "epoch");
    refuse_texts("lg-elastica", "search bad.yaml data.h5 --out s.csv", elastica_ranges,
                 LG_COUNT(elastica_ranges));
    assert_false(cli_exists("s.csv"));
    char line[2048] = "predict model.h5 --x 1 --s 0";
    for (int i = 1; i < 256; i++) (void)strcat(line, ",1");
    RUN("lg-elastica", line);
    (void)strcat(line, ",1");
    cli_expect("lg-elastica", line, 2,
               "--s: a list of 257 numbers is too long; at most 256 are allowed; use --points\n");
    (void)strcat(line, ",x");
    cli_expect("lg-elastica", line, 2, "a list of 258 numbers");
    (void)strcpy(line + sizeof "predict model.h5 --x 1 --s 0" + 300, "x");
    cli_expect("lg-elastica", line, 2, ",1,1,...' is not a list");
}
#undef TRAIN

/* ---- lg-anomaly ---- */

#define TRAIN "train data.h5 --out m.h5 "
#define WATCH "watch tree.h5 --input feed.csv "

/* Windows of class c are normal noise of mean 2 c and standard deviation 1 + 3 c. */
static void write_series(const char *name, size_t count, uint32_t channels, uint32_t length,
                         uint32_t classes) {
    lg_series_data data = {.noise = NAN, .severity = NAN};
    data.series = (lg_series){.count = count, .channels = channels, .length = length, .classes = classes};
    assert_ok(lg_series_allocate(NULL, &data.series, false, false));
    lg_rng rng = test_rng(11, 0);
    for (size_t i = 0; i < count; i++) {
        const uint32_t c = data.series.label[i] = (uint32_t)(i % classes);
        for (size_t k = 0; k < (size_t)channels * length; k++)
            data.series.x[i * channels * length + k] = (float)(2.0 * c + (1 + 3.0 * c) * lg_rng_normal(&rng));
    }
    assert_ok(lg_series_write(NULL, cli_at(name), &data, NULL));
    lg_series_data_destroy(&data);
}

static const refusal anomaly[] = {
    {"", 2, "a command is missing"},
    {"guess", 2, "'guess' is not a command"},
    {"generate", 2, "--out FILE is missing"},
    {"generate --out nowhere/s.h5", 3, "nowhere/s.h5"},
    {"generate --out s.h5 {--noise=-1 --noise=nan --runs=0 --hours=0 --severity=0 --severity=1.1 "
     "--plot=s.jpg}",
     2, NULL},
    {"generate --out s.h5 --housing loose", 2, "'loose' is not one of slack, tight"},
    {"generate --out s.h5 --operation fishing", 2, "'fishing' is not one of drilling, completion"},
    {"generate --out s.h5 {--load-relief=-1 --load-relief=nan}", 2, NULL},
    {"generate --out s.h5 --window 0.3", 2, "--window 0.3: is 1.5 samples"},
    {"generate --out s.h5 --window 7200", 2, "shorter than one window"},
    {"generate --out s.h5 --runs 100000 --hours 1000 --window 0.2", 2, "more than a file may hold"},
    {"generate --out s.h5 --plot-kind housings", 2, "--plot-kind: needs --plot FILE"},
    {"feed {--hours=0 --gaps=-1}", 2, NULL},
    {"feed --json", 2, "--json: the feed would also go to standard output"},
    {"feed --out nowhere/f.csv", 3, "nowhere/f.csv"},
    {"train", 2, "missing argument"},
    {"train data.h5", 2, "--out FILE is missing"},
    {"train data.h5 --out data.h5", 2, "--out: data.h5 is an input"},
    {"train {missing.h5 empty.h5 foreign.h5 model.h5} --out m.h5", 3, "%"},
    {TRAIN "--classifier forest", 2, "'forest' is not one of cnn, logistic"},
    {TRAIN "--features cov", 2, "--features: --classifier cnn has no such option"},
    {TRAIN "--classifier tree --lr 1", 2, "--lr: --classifier tree has no such option"},
    {TRAIN "--classifier logistic --gamma 1", 2, "--gamma: --classifier logistic"},
    {TRAIN "--classifier svm-rbf --c 1 --grid 1,2", 2, "--grid and --c cannot be given together"},
    {TRAIN "--classifier svm-rbf --grid 1,0", 2, "--grid: '1,0' is not a list of numbers above 0"},
    {TRAIN "--prior 0.1", 2, "unrecognized option '--prior'"},
    {TRAIN "--classifier tree --seconds=1", 2, "--classifier tree has no such option"},
    {TRAIN "--size auto", 2, "unrecognized option '--size'"},
    {TRAIN "--classifier rocket --features cov", 2, "--classifier rocket needs a number"},
    {TRAIN "--classifier rocket --features 50", 2, "50 random convolution features: expected 96"},
    {TRAIN "--classifier rocket --prune pre", 2, "--classifier rocket needs a number"},
    {TRAIN "--classifier logistic --features 1000", 2, "only --classifier rocket takes a number"},
    {TRAIN "--classifier tree --prune 10", 2, "--classifier tree takes none, pre or post"},
    {TRAIN "--classifier rocket --components 3", 2, "--classifier rocket has no such option"},
    {TRAIN "--classifier rocket --window 1", 2, "a window of 5 samples is too short"},
    {TRAIN "--features cow", 2, "'cow' is neither raw, std, cov, spectrum or levels nor"},
    {TRAIN "--classifier tree --ccp-alpha 0.1", 2, "--ccp-alpha: needs --prune post"},
    {TRAIN "--classifier tree --prune pre --max-depth 3", 2, "--prune pre: chooses"},
    {TRAIN "--test-fraction 0.9 --validation-fraction 0.5", 2, "together below 1"},
    {TRAIN "--window 0.3", 2, "--window 0.3: is 1.5 samples"},
    {TRAIN "--window 3600", 2, "18000"},
    {TRAIN "--hop 0", 2, "--hop 0: is 0 samples"},
    {"train three.h5 --out m.h5 --window 2.5", 2, "the sampling rate of the data is unknown: give samples"},
    {"train three.h5 --out m.h5 --loss mse", 2, "--loss mse is for two classes, but the data have 3"},
    {"train three.h5 --out m.h5 --split {run group}", 2, "%"},
    {"train single.h5 --out m.h5 --classifier {cnn tree}", 2, "all windows are of one class, '0'"},
    {TRAIN "--test {three.h5 missing.h5}", 3, "%"},
    {"train data.h5 --out fresh.h5 --test fresh.h5", 2, "--out: fresh.h5 is an input of --test"},
    {TRAIN "--test fresh.h5 --test-fraction 0.1", 2, "--test and --test-fraction cannot be given together"},
    {TRAIN "--kernel 200", 2, "block"},
    {TRAIN "--filters 1,2,3,4,5,6,7,8,9", 2,
     "--filters: a list of 9 numbers is too long; at most 8 are allowed"},
    {TRAIN "--classifier logistic --components 1000", 2, "component"},
    {TRAIN "--classifier logistic --features spectrum --window 0.6", 2,
     "too short for a spectrum, which needs 4"},
    {"train three.h5 --out m.h5 --classifier baseline", 2, "channel"},
    {TRAIN "--plot-kind roc", 2, "--plot-kind: needs --plot FILE"},
    {TRAIN "--plot p.svg --plot-kind tree", 2, "--plot-kind tree: the model is not a tree"},
    {TRAIN "--classifier tree --plot p.svg --plot-kind loss", 2, "--plot-kind loss: is drawn"},
    {TRAIN "--resume {missing.h5 model.h5}", 3, "%"},
    {TRAIN "--resume model.h5 --preset best", 3, "model.h5: attribute kind"},
    {"evaluate model.h5", 2, "missing argument"},
    {"evaluate {missing.h5 foreign.h5} data.h5", 3, "%"},
    {"evaluate data.h5 data.h5", 3, "attribute kind is 'series', expected 'detector' or"},
    {"evaluate old.h5 data.h5", 3, "train the model"},
    {"evaluate model.h5 {model.h5 three.h5}", 3, "%"},
    {"evaluate model.h5 fresh.h5 --part test", 2,
     "--part test: model.h5 was trained on other data than fresh.h5"},
    {"evaluate logistic.h5 data.h5 --part validation", 2, "no windows in it"},
    {"evaluate model.h5 data.h5 --votes {3 6,5}", 2, "--votes: expected two numbers"},
    {"evaluate three-model.h5 three.h5 --votes 3,5", 2, "--votes: three.h5 has no recordings"},
    {"evaluate model.h5 data.h5 --scores model.h5", 2, "--scores: model.h5 is an input"},
    {"evaluate model.h5 data.h5 fresh.h5 --scores s.csv", 2, "take one data file only"},
    {"evaluate model.h5 data.h5 --plot-kind roc", 2, "--plot-kind: needs --plot FILE"},
    {"evaluate model.h5 data.h5 --plot p.svg --plot-kind loss", 2, "'loss' is not one of default, pairs"},
    {"evaluate logistic.h5 data.h5 --plot p.svg --plot-kind pruning", 2, "'pruning' is not one of"},
    {"evaluate model.h5 data.h5 --plot p.svg --plot-kind clouds", 2,
     "--plot-kind clouds: the model has no features"},
    {"evaluate model.h5 brief.h5", 3, "brief.h5: not one window of 150 samples fits"},
    {TRAIN "--test brief.h5 --classifier {cnn tree}", 3, "brief.h5: not one window of 150 samples fits"},
    {"search ranges.yaml data.h5", 2, "--out FILE.csv is missing"},
    {"search missing.yaml data.h5 --out s.csv", 3, "missing.yaml"},
    {"search ranges.yaml missing.h5 --out s.csv", 3, "missing.h5"},
    {"search ranges.yaml data.h5 --out ranges.yaml", 2, "--out: ranges.yaml is an input"},
    {"watch", 2, "MODEL.h5"},
    {"watch {none.h5 feed.csv data.h5} --input feed.csv", 3, "%"},
    {"watch tree.h5 --input none.csv", 3, "none.csv"},
    {"watch tree.h5 --input .", 3, "directory"},
    {WATCH "--votes {6,5 6 1,2,3}", 2, "--votes"},
    {WATCH "{--votes=0,5 --votes=1,65 --bridge=-1 --missing=1.5 --crack-at=soon --hop=nan}", 2, NULL},
    {WATCH "--hop {31 0.01}", 2, "--hop %"},
    {"watch tree.h5 --quiet --input words.csv", 3, "no line holds 6 numbers"},
    {"watch tree.h5 --quiet --input wide.csv", 3, "line 1: more than 7 numbers"},
};

static const char *const anomaly_ranges[][2] = {
    {"fixed: {bogus: 1}\nranges:\n  plane: {integer: [0, 4]}\n", "line 1: 'bogus' is not an option of train"},
    {"fixed:\n  test: m.h5\nranges:\n  plane: {integer: [0, 4]}\n", "line 2: 'test' is not an option"},
    {"ranges:\n  lr: {uniform: [0.1, 1]}\n  c: {uniform: [1, 2]}\n",
     "line 3: c: --classifier cnn has no such option"},
    {"ranges:\n  max-depth: {integer: [1, 2]}\n", "line 2: max-depth: --classifier cnn has"},
    {"fixed: {method: cnn}\nranges:\n  components: {choice: [1, 2]}\n",
     "line 3: components: --classifier cnn"},
    {"fixed:\n  lr: 0.1\n  prune: pre\nranges:\n  plane: {integer: [0, 4]}\n",
     "line 3: prune: --classifier cnn"},
    {"ranges:\n  method: {choice: [cnn, tree]}\n", "line 2: a search does not train 'method: tree'"},
    {"fixed: {method: tree}\nranges:\n  plane: {integer: [0, 4]}\n",
     "line 1: a search does not train 'method: tree'"},
    {"ranges:\n  method: {choice: [cnn, rocket]}\n  max-depth: {integer: [1, 2]}\n", "line 3: max-depth: --"},
    {"fixed: {method: rocket}\nranges:\n  features: {choice: [50, cov]}\n",
     "line 3: --features: --classifier rocket needs a number"},
    {"ranges:\n  prune: {choice: [10, pre]}\n  method: {choice: [cnn, rocket]}\n  plane: {integer: [0, 4]}\n",
     "line 2: --prune: --classifier rocket needs a number"},
};

TEST("lg-anomaly refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("ranges.yaml", "fixed: {epochs: 1}\nranges:\n  plane: {integer: [0, 3]}\n");
    cli_write("feed.csv", "1,2,3,4,5,6\n");
    cli_write("words.csv", "acc,moment\nfoo,bar\n");
    cli_write("wide.csv", "1,2,3,4,5,6,7,8\n1,2,3,4,5,6,7,8\n");
    write_series("three.h5", 60, 2, 40, 3);
    write_series("single.h5", 10, 2, 20, 1);
    make_kind("old.h5", "classifier"); /* in format 1 */
    RUN("lg-anomaly", "generate --runs 16 --hours 0.1 --noise 1 --window 30 --out data.h5",
        "generate --runs 4 --hours 0.1 --noise 1 --window 30 --seed 9 --out fresh.h5",
        "generate --runs 2 --hours 0.005 --window 10 --out brief.h5",
        "train data.h5 --epochs 1 --out model.h5", "train data.h5 --classifier logistic --out logistic.h5",
        "train data.h5 --classifier tree --out tree.h5", "train three.h5 --epochs 1 --out three-model.h5");
    REFUSE("lg-anomaly", anomaly);
    refuse_texts("lg-anomaly", "search bad.yaml data.h5 --out s.csv", anomaly_ranges,
                 LG_COUNT(anomaly_ranges));
    cli_expect("lg-anomaly",
               TRAIN
               "--filters 30,30,30,30,30,30,30,30 --kernel 1 --pooling none --activation identity --lr 1e3 "
               "--schedule constant --epochs 3",
               4, "; the state before this failure is in m.h5.checkpoint");
}

/* ---- lg-simulate ---- */

static const refusal simulate[] = {
    {"", 2, "missing argument; expected: SCENE.yaml"},
    {"missing.yaml", 3, "missing.yaml"},
    {".", 3, "."},
    {"no-end.yaml", 2, "no final time: give --t-end T"},
    {"chain.yaml oscillator.yaml", 2, "too many arguments"},
    {"chain.yaml --bogus", 2, "--bogus"},
    {"chain.yaml --scheme leapfrog", 2, "'leapfrog' is not one of euler, implicit-euler, midpoint"},
    {"chain.yaml --scheme symplectic-euler --steps 10", 2, "not separable; methods that apply: euler,"},
    {"chain.yaml --scheme slgi --steps 10", 2, "heavy-top, form cotangent or quadratic"},
    {"direct.yaml --scheme slgi --steps 10", 2, "does not apply to heavy-top, direct"},
    {"cotangent.yaml --scheme variational --steps 10", 2, "no discrete Lagrangian"},
    {"chain.yaml --scheme rkmk4", 2,
     "'rkmk4' needs --steps N, because it does not estimate its error; adaptive"},
    {"chain.yaml --scheme rkmk4 --tolerance 1e-6", 2, "--tolerance: 'rkmk4' does not estimate its error"},
    {"chain.yaml --steps 10 --tolerance 1e-6", 2, "--steps (equal steps) and --tolerance"},
    {"chain.yaml {--steps=0 --steps=-3 --steps=1e3 --tolerance=0 --tolerance=nan --tolerance=-1e-3 --atol=-1 "
     "--t-end=0 "
     "--t-end=-1 --t-end=inf --points=1}",
     2, NULL},
    {"cotangent.yaml --scheme slgi --steps 10 {--theta=1.5 --theta=-0.1}", 2, NULL},
    {"chain.yaml --scheme rkmk4 --steps 10 --theta 0.5", 2, "--theta: 'rkmk4' has no parameter theta"},
    {"chain.yaml --dexpinv {11 most}", 2, "--dexpinv: '%' is neither"},
    {"chain.yaml --scheme cf4 --steps 10 --dexpinv 2", 2, "--dexpinv: 'cf4' has no dexpinv"},
    {"chain.yaml --scheme missing.yaml", 3, "missing.yaml"},
    {"chain.yaml --scheme chain.yaml --steps 10", 3, "chain.yaml: line"},
    {"chain.yaml --scheme rk4 --method leapfrog", 2, "--scheme: 'leapfrog' is not one of"},
    {"chain.yaml --scheme verlet.yaml --steps 50", 2, "not separable"},
    {"chain.yaml --scheme kutta3.yaml", 2, "'kutta3' needs --steps"},
    {"chain.yaml {--out=nowhere/t.h5 --plot=nowhere/t.svg}", 3, "%"},
    {"chain.yaml --out .", 3, "folder"},
    {"chain.yaml --out chain.yaml", 2, "--out: chain.yaml is an input and would be replaced"},
    {"chain.yaml --scheme oscillator.yaml --out oscillator.yaml", 2, "is an input of --scheme"},
    {"chain.yaml --gradient @oscillator.yaml --out oscillator.yaml", 2, "is an input of --gradient"},
    {"chain.yaml --out t.dat --plot t.svg", 2, "--plot: t.dat is also the output file of --out"},
    {"chain.yaml --plot t.pdf", 2, "t.pdf"},
    {"chain.yaml --plot-kind 3d", 2, "--plot-kind: needs --plot"},
    {"chain.yaml --plot t.svg {--plot-kind=pie}", 2, NULL},
    {"oscillator.yaml --plot t.svg --plot-kind 3d", 2, "no spatial plot of oscillator"},
    {"chain.yaml --points 5 --times 0,1", 2, "--points and --times cannot be given together"},
    {"chain.yaml --times 0.5,{0.2 2} --out t.h5", 2, "--times: %"},
    {"chain.yaml --scheme rk4 --steps 10 --points 4 --out t.h5", 2,
     "3 intervals, which do not divide 10 steps"},
    {"chain.yaml --scheme rk4 --steps 10 --times 0.25 --out t.h5", 2,
     "--times: 0.25 is not a multiple of the step"},
    {"chain.yaml --gradient 1,2", 2, "2 weights, but the state has 12 numbers: q1 omega1 q2 omega2"},
    {"chain.yaml --gradient 1,x", 2, "'x' is not a number"},
    {"chain.yaml --gradient @missing.txt", 3, "missing.txt"},
    {"chain.yaml --scheme variational --steps 400 --gradient 1,1,1,1,1,1,1,1,1,1,1,1", 2,
     "'variational' cannot be differentiated on pendulum-chain, lagrangian"},
    {"chain.yaml --checkpoints 4", 2, "--checkpoints: needs --gradient"},
    {"chain.yaml --work-precision --gradient 1,2", 2,
     "--work-precision and --gradient cannot be given together"},
    {"chain.yaml --work-precision --schemes rk4,leapfrog", 2, "--schemes: 'leapfrog' is not one of"},
    {"chain.yaml --work-precision --schemes stormer-verlet", 2, "not separable"},
    {"chain.yaml --work-precision --schemes rk4 --theta 0", 2, "--theta: 'rk4' has no parameter theta"},
    {"chain.yaml --schemes rk4", 2, "--schemes: needs --work-precision"},
    {"oscillator.yaml --vary q=sphere", 2, "--vary: needs --ensemble"},
    {"oscillator.yaml --ensemble 5 --gradient 1,0", 2, "cannot be given together"},
    {"oscillator.yaml --ensemble 5 --vary q", 2, "expected NAME = DISTRIBUTION"},
    {"oscillator.yaml --ensemble 5 --vary x=normal:0:1", 2, "'x' is neither a parameter"},
    {"oscillator.yaml --ensemble 5 --vary q=gauss:0:1", 2, "'gauss' is not one of"},
    {"oscillator.yaml --ensemble 5 --vary q=normal:0", 2, "expected 'normal MEAN DEVIATION'"},
    {"oscillator.yaml --ensemble 5 --vary q=normal:0:-1", 2, "sizes of 0 or more"},
    {"oscillator.yaml --ensemble 5 --vary q=uniform:2:1", 2, "LOW <= HIGH"},
    {"oscillator.yaml --ensemble 5 --vary q=sphere", 2, "vectors or matrices of 3 numbers"},
    {"oscillator.yaml --ensemble 5 --event q", 2, "expected NAME=VALUE"},
    {"oscillator.yaml --ensemble 5 --event z=1", 2, "'z' is not a number of the state"},
    {"oscillator.yaml --ensemble 5 --task 1/2", 2, "give --out"},
    {"oscillator.yaml --ensemble 5 --task 2/2 --out a.h5", 2, "0 <= i < n"},
    {"oscillator.yaml --ensemble 5 --save all", 2, "give --out"},
    {"oscillator.yaml --ensemble 5 --save some --out a.h5", 2, "neither all nor a whole number"},
    {"oscillator.yaml --ensemble 5 --scheme rk4", 2, "needs --steps"},
    {"oscillator.yaml --ensemble 5 --scheme rk4 --steps 7 --points 3", 2, "multiple of the step"},
    {"oscillator.yaml --ensemble 5 --members missing.csv", 3, "missing.csv"},
    {"oscillator.yaml --ensemble 2 --members start.csv", 3,
     "start.csv: line 3: column q: the value is missing"},
    {"oscillator.yaml --t-end 1e18", 4, "the step size fell below the rounding of time at t = 0"},
    {"chain.yaml --max-steps 5", 4, "in 5 steps (--max-steps)"},
    {"chain.yaml --scheme euler --steps 40 --t-end 1e6", 4, "not finite"},
};

/* A scheme with more stages than the limit. */
#define TEXT_OF(x) #x
#define TEXT(x)    TEXT_OF(x)
#define MANY       "0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01"

static const char *const schemes[][2] = {
    {"order: 3\n", "kind"},
    {"kind: magic\norder: 3\n", "'magic' is none of rkmk, runge-kutta, commutator-free, splitting"},
    {"kind: rkmk\n", "order"},
    {"kind: rkmk\norder: 3\nb: [1]\n", "needs the key 'a'"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\nkick: [1]\n",
     "line 5: kick: a scheme of kind rkmk has no such key"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\nb: [1]\n", "line 5"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1]\ncolour: red\n", "colour"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [0.9]\n", "weights do not sum to 1"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [one]\n", "line 4: b: 'one' is neither a number nor a quotient"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [1/0]\n", "'1/0'"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: 1\n", "0 stages"},
    {"kind: rkmk\norder: 1\na: [[]]\nb: [" MANY "," MANY "," MANY "," MANY "]\n",
     "40 stages, expected 1 to " TEXT(LG_SCHEME_MAX_STAGES)},
    {"kind: rkmk\norder: 2\na: [[]]\nb: [0.5, 0.5]\n", "line 3: a: a list for each stage"},
    {"kind: rkmk\norder: 2\na: [[1], [1]]\nb: [0.5, 0.5]\n", "not explicit"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\nc: [0, 0.5]\n", "a number of c is not the sum"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\ndexpinv: 12\n", "dexpinv: '12'"},
    {"kind: rkmk\norder: 2\nembedded_order: 1\na: [[], [1]]\nb: [0.5, 0.5]\nembedded: [0.5, 0.5]\n",
     "cannot estimate the error"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\nembedded: [1, 0]\n", "must be given together"},
    {"kind: rkmk\norder: 2\na: [[], [1]]\nb: [0.5, 0.5]\ncommutators: [[1, 1, 9, 0.5]]\n", "commutators"},
    {"kind: commutator-free\norder: 1\nrows: [[]]\n", "0 stages"},
    {"kind: commutator-free\norder: 1\nrows: [[], [0.5]]\n", "do not sum"},
    {"kind: commutator-free\norder: 1\nrows: [[], {base: 2, exponentials: []}]\n", "base"},
    {"kind: commutator-free\norder: 1\nrows: [[], {bass: 1}]\n", "`base` and `exponentials`"},
    {"kind: splitting\norder: 1\nkick: [1]\ndrift: [1, 0]\n", "2 numbers, at most 1"},
    {"[", "bad.yaml: line"},
};

TEST("lg-simulate refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("oscillator.yaml", "system: oscillator\ninitial: {q: 0.6, p: -0.8}\nt_end: 3\n");
    cli_write("start.csv", "q,p\n1,0\n,2\n");
    cli_write("no-end.yaml", "system: oscillator\ninitial: {q: 0.6, p: -0.8}\n");
    cli_write("chain.yaml",
              "system: pendulum-chain\nform: lagrangian\ngravity: 9.81\nmasses: [1, 1.3]\n"
              "lengths: [1, 0.8]\ninitial: {q: [[0.8, 0, -0.6], [0, 0.6, 0.8]], omega: [[0.3, 0.5, "
              "0.4], [0.2, 0.3, -0.225]]}\nt_end: 1\n");
    cli_write("kutta3.yaml",
              "name: kutta3\nkind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3, 1/6]\n");
    cli_write("verlet.yaml", "kind: splitting\norder: 2\nkick: [0.5, 0.5]\ndrift: [1, 0]\n");
    for (const char *form = "direct\0cotangent\0"; *form != '\0'; form += strlen(form) + 1) {
        char text[512];
        const char *name = test_text("%s.yaml", form);
        (void)snprintf(
            text, sizeof text,
            "system: heavy-top\nform: %s\ninertia: [0.5, 0.6, 0.3]\nmass: 1\nlength: 0.5\n"
            "chi: [0, 0, 1]\ngamma0: [0, 0, -9.81]\ninitial: {Q: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "
            "pi: [0.2, -1, 2]}\nt_end: 0.5\n",
            form);
        cli_write(name, text);
    }
    REFUSE("lg-simulate", simulate);
    refuse_texts("lg-simulate", "chain.yaml --scheme bad.yaml --steps 10", schemes, LG_COUNT(schemes));
}

/* ---- lg-fit ---- */

/* test_fit_cli has tables whose text is wrong. */
static const refusal fit[] = {
    {"train", 2, "missing argument"},
    {"train x.csv", 2, "--out FILE is missing"},
    {"train gone.csv --out m.h5", 3, "No such file"},
    {"train . --out m.h5", 3, "is not a regular file"},
    {"train empty.h5 --out m.h5", 3, "is empty"},
    {"train foreign.h5 --out m.h5", 3, "no rows"},
    {"train x.csv --out no/folder/m.h5", 3, "no/folder"},
    {"train x.csv --out x.csv", 2, "--out: x.csv is an input"},
    {"train x.csv --out m.h5 --test m.h5", 2, "--out: m.h5 is an input of --test"},
    {"train x.csv --out m.h5 --plot m.txt", 2, "m.txt"},
    {"train x.csv --out m.h5 --test gone.csv", 3, "train: gone.csv: "},
    {"train k.csv --class k --out m.h5 --test other.csv", 3,
     "train: other.csv: line 3: the model does not know class 'z'"},
    {"evaluate foreign.h5 foreign.h5", 3, "foreign.h5"},
    {"predict gone.h5 foreign.h5", 3, "gone.h5"},
};

TEST("lg-fit refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("x.csv", "a,y\n1,2\n2,3\n3,5\n");
    cli_write("k.csv", "a,k\n1,x\n2,y\n3,x\n4,y\n");
    cli_write("other.csv", "a,k\n1,x\n2,z\n");
    REFUSE("lg-fit", fit);
}

/* ---- lg-identify ---- */

static const refusal identify[] = {
    {"{check fit}", 2, "lg-identify %"},
    {"check machine.yaml", 2, "lg-identify check"},
    {"check machine.yaml none.csv", 3, "none.csv"},
    {"check none.yaml log.csv", 3, "none.yaml"},
    {"check machine.yaml log.csv --plot plot.pdf", 2, "plot.pdf"},
    {"fit machine.yaml log.csv --out m.h5 --size auto", 2, "--size"},
    {"predict empty.h5 log.csv --out p.csv", 3, "empty.h5"},
    {"predict empty.h5 log.csv", 2, "--out"},
    {"evaluate empty.h5 log.csv --horizons=-1", 2, "horizons"},
    {"evaluate foreign.h5 log.csv", 3, "foreign.h5"},
    {"generate machine.yaml", 2, "--out"},
    {"generate machine.yaml --out g.csv --runs 1", 3, "machine.yaml: potential: a term of kind 'quadratic'"},
    {"generate one.yaml --out g.csv", 3, "--runs 1"},
    {"generate one.yaml --out g.csv --runs 1 --excitation log.csv", 2, "the machine has no inputs"},
    {"generate driven.yaml --out g.csv --excitation none.csv", 3, "none.csv"},
    {"generate driven.yaml --out g.csv --excitation single.csv", 3,
     "two rows or more whose time rises, but there are 1"},
    {"generate driven.yaml --out g.csv --excitation long.csv", 2, "more than 1e+09 rows"},
    {"generate driven.yaml --out g.csv --excitation {steps:0 steps:-1 steps:x multisine:}", 2,
     "expected a number above 0"},
    {"generate driven.yaml --out g.csv --amplitude 1,2", 2, "--amplitude: 2 numbers"},
};

TEST("lg-identify refuses wrong command lines and files with exit code and message, and writes nothing") {
    static const char line[] = "coordinates:\n  - {name: x, kind: line, velocity: v}\n";
    static const char known[] = "mass: {kind: known, values: [1]}\n";
    cli_test_folder();
    cli_write("machine.yaml", test_text("%spotential: {kind: quadratic, of: x}\n", line));
    cli_write("one.yaml", test_text("%s%s", line, known));
    cli_write("driven.yaml", test_text("columns: {run: run}\n%s%sinputs: {columns: [u]}\n"
                                       "input_map: {kind: known, values: [[1]]}\n",
                                       line, known));
    cli_write("single.csv", "t,u\n0,1\n");
    cli_write("long.csv", "t,u\n0,1\n1e300,1\n");
    RUN("lg-identify", "generate one.yaml --out log.csv --runs 1");
    REFUSE("lg-identify", identify);
}

/* ---- lg-learn ---- */

static const refusal learn[] = {
    {"train data.h5 --out m.h5", 2, "--recipe NAME is missing"},
    {"train data.h5 --recipe potato --out m.h5", 2, "--recipe: 'potato' is not one of hamiltonian, "},
    {"train data.h5 --recipe=tables --out m.h5", 2, "--recipe: 'tables' is not one of"},
    {"train data.h5 --recipe surrogate --out m.h5", 3, "data.h5: attribute kind is 'trajectories'"},
    {"train data.h5 --recipe hamiltonian --out m.h5 --modes 3", 2, "--modes"},
    {"train data.h5 more.h5 --recipe hamiltonian --out m.h5", 2,
     "more.h5: there are too many arguments; the recipe hamiltonian takes only DATA.h5"},
    {"search ranges.yaml data.h5 more.h5 --recipe hamiltonian --out t.csv", 2, "takes only DATA.h5"},
    {"train machine.yaml --recipe machine_model --out m.h5", 2, "needs MACHINE.yaml LOG..."},
    {"evaluate model.h5 data.h5 more.h5", 2, "takes only DATA.h5"},
    {"evaluate data.h5 data.h5", 3, "it is a data file with trajectories"},
    {"evaluate model.h5 foreign.h5", 3, "foreign.h5"},
    {"evaluate program.h5 data.h5", 3, "no recipe belongs to the kind 'program'"},
    {"predict model.h5", 2, "--initial: 0 numbers are given, but the model takes 6"},
    {"predict model.h5 --initial 1,0,0", 2, "--initial: 3 numbers are given, but the model takes 6"},
    {"predict model.h5 --initial 1,1,0,0,0,0", 2, "the start is off the manifold by 0.29"},
    {"predict still.h5 --initial 0,0 {--t-end=3 --points=5 --tolerance=1e-6 --out=w.csv}", 2,
     "and still.h5 has none"},
};

TEST("lg-learn refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_link(LG_TEST_DIR "/models/chain.h5", "model.h5");
    cli_link(LG_TEST_DIR "/models/program.h5", "program.h5");
    cli_link(LG_TEST_DIR "/models/table.h5", "still.h5");
    RUN("lg-hamiltonian",
        "generate " LG_TEST_DIR "/../scenes/pendulum.yaml --trajectories 4 --points 2 --out data.h5");
    REFUSE("lg-learn", learn);
}

/* ---- lg-export ---- */

static const refusal export[] = {
    {"", 2, "missing argument"},
    {"pendulum.h5", 2, "--out is missing"},
    {"pendulum.h5 beam.h5 --out o", 2, "too many arguments: 'beam.h5'"},
    {"pendulum.h5 --out o --bogus", 2, "--bogus"},
    {"pendulum.h5 --out o --dtype f16", 2, "'f16' is not one of f64, f32"},
    {"pendulum.h5 --out o {--golden=0 --golden=1001 --seed=x}", 2, NULL},
    {"pendulum.h5 --out o --name {2x _x}", 2, "begin with a letter"},
    {"pendulum.h5 --out o --name {a-b a/b}", 2, "only letters, digits and _"},
    {"pendulum.h5 --out o --name {a__b a_}", 2, "reserved"},
    {"pendulum.h5 --out o --name {int class xor_eq math}", 2, "reserved by C or C++"},
    {"pendulum.h5 --out o --name {Makefile makeFILE}", 2, "make treats files"},
    {"pendulum.h5 --out o --name {golden NAME}", 2, "words with this beginning"},
    {"pendulum.h5 --out o --name a1234567890123456789012345678901234567890", 2, "1 to 40 characters"},
    {"pendulum.h5 --out o --name class --golden 2 --scheme nothing", 2, "--name: 'class'"},
    {"pendulum.h5 --out o --scheme nothing", 2, "cf4"},
    {"pendulum.h5 --out o --scheme {rk4 stormer-verlet slgi}", 2, "%"},
    {"pendulum.h5 --out o --scheme {rk4 stormer-verlet slgi midpoint}", 2, "Lie group"},
    {"flat.h5 --out o --scheme {midpoint implicit-euler variational}", 2, "explicit"},
    {"machine.h5 --out o --scheme rk4", 2, "Lie group"},
    {"machine.h5 --out o --functions step", 2, "only linearise"},
    {"machine.h5 --out o --compact", 2, "for programs"},
    {"machine.h5 --out o --target {fmu2 fmu3 simulink} --functions value,field", 2,
     "--functions: field is a part of the rate velocity"},
    {"machine.h5 --out o --target onnx --functions value,field", 2, "an ONNX file has one function"},
    {"huge.h5 --out o --target {c casadi fmu2 fmu3 simulink package}", 3,
     "numbers that are not finite or too large"},
    {"program.h5 --out o --functions value,nothing", 2, "the program has no function 'nothing'"},
    {"program.h5 --out o --functions ,", 2, "no function is named"},
    {"program.h5 --out o --name dense", 2, "cannot be the name"},
    {"program.h5 --out o --scheme cf4", 2, "--scheme is for Hamiltonians"},
    {"pendulum.h5 --out o --scheme {missing.yaml bad.yaml ./pendulum.h5}", 3, "%"},
    {"{beam.h5 hollow-classifier.h5} --out o --scheme cf4", 2, "--scheme is for Hamiltonians"},
    {"{missing.h5 empty.h5 foreign.h5 /dev/null . hollow.h5 hollow-classifier.h5} --out o", 3, "%"},
    {"data.h5 --out o", 3, "trajectories"},
    {"check.h5 --out o", 3, "checkpoint"},
    {"odd.h5 --out o", 3,
     "'poem', expected hamiltonian, surrogate, detector, table, machine_model or any kind with functions: "
     "its kind is unknown"},
    {"hollow-program.h5 --out o", 3, "hollow-program.h5: attribute format_version is 1"},
    {"pendulum.h5 --out foreign.h5", 3, "foreign.h5: cannot be written: Not a directory"},
    {"pendulum.h5 --out nowhere/o", 3, "there is no folder nowhere"},
    {"pendulum.h5 --out pendulum.h5/o", 3, "Not a directory"},
    {"pendulum.h5 --out {/dev/null /proc/o dangling}", 3, "%"},
};

/* A machine on a line whose mass and input have the factor `by`. */
#define FORCED(by)                                                                                           \
    "columns: {time: t, run: r}\ncoordinates: [{name: x, kind: line, velocity: vx}]\n"                       \
    "inputs: {columns: [u], hold: zero}\ninput_map: {kind: known, values: [[" by                             \
    "]]}\nmass: {kind: known, values: [" by "]}\n"

TEST("lg-export refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("scene.yaml", "system: pendulum-chain\ngravity: 1\nmasses: [1]\nlengths: [1]\n");
    cli_write("bad.yaml", "kind: rkmk\norder: 3\na: [[], [1/2], [-1, 2]]\nb: [1/6, 2/3]\n");
    RUN("lg-hamiltonian", "generate scene.yaml --trajectories 4 --points 2 --out train.h5",
        "train train.h5 --epochs 1 --hidden 4 --out pendulum.h5");
    RUN("lg-elastica", "generate --count 4 --intervals 4 --out curves.h5",
        "train curves.h5 --epochs 1 --hidden 3 --layers 1 --out beam.h5");
    /* the squares of its forces are beyond double precision, so no self-test can compare them */
    cli_write("truth.yaml", FORCED("1") "potential: none\ndamping: {kind: known, values: [0.1]}\n");
    cli_write("huge.yaml",
              FORCED("1e200") "potential: {kind: network, of: x, hidden: [4]}\ndamping: diagonal\n");
    RUN("lg-identify", "generate truth.yaml --runs 3 --t-end 2 --excitation multisine --out log.csv",
        "fit huge.yaml log.csv --epochs 3 --out huge.h5");
    make_kind("data.h5", "trajectories");
    make_kind("check.h5", "checkpoint");
    make_kind("odd.h5", "poem");
    make_kind("hollow.h5", "hamiltonian");
    make_kind("hollow-classifier.h5", "classifier");
    make_kind("hollow-program.h5", "program");
    cli_link("nothing/there", "dangling");
    cli_link(LG_TEST_DIR "/models/separable.h5", "flat.h5");
    cli_link(LG_TEST_DIR "/models/machine.h5", "machine.h5");
    cli_link(LG_TEST_DIR "/models/program.h5", "program.h5");
    REFUSE("lg-export", export);
}

/* ---- lg-bench ---- */

static const refusal bench[] = {
    {"nothing", 2, "lg-bench"},
    {"mlp2 {--batch=0 --dtype=f16 --repeats=x --width=-1}", 2, "lg-bench"},
    {"act --repeats 1 --only nothing", 2, "lg-bench"},
    {"{scalar ode} --dtype f32", 2, "f64"},
    {"hamiltonian --weights {scene.yaml missing}", 3, "%"},
    {"hamiltonian-quartic --weights set.weights --out set", 2, "--out: set.weights is an input of --weights"},
};

TEST("lg-bench refuses wrong command lines and files with exit code and message, and writes nothing") {
    cli_test_folder();
    cli_write("scene.yaml", "no weights\n");
    cli_write("set.weights", "");
    REFUSE("lg-bench", bench);
}
