/* Checks that an option has the same meaning in all commands of all programs. Reads the options from
 * --help. */
#include "cli_support.h"

/* Options whose unit or description differs between commands, and why. */
static const char *const meanings[][2] = {
    {"activation", "of hidden layers, or between layers and of all layers of a cnn"},
    {"batch", "its samples are trajectories, curves, windows, rows"},
    {"case", "a train of lg-elastica generate has both"},
    {"continuous", "to solve or to store"},
    {"crack-at", "hours of a feed, or seconds of a trial with a known truth"},
    {"dtype", "of training, of the code, of a measurement"},
    {"epochs", "a total, or evaluations of a demo"},
    {"gamma", "published name: of a kernel, of a penalty"},
    {"hidden", "one width for all layers, or a list"},
    {"hours", "of a recording, of a feed"},
    {"jobs", "trials, runs of a study"},
    {"inputs", "columns to learn from, or what the inputs of a machine do"},
    {"loss", "the losses of detectors and surrogates"},
    {"method", "of training, of classification, of integration"},
    {"metric", "over trajectories, over parts"},
    {"network", "kind of surrogate, architecture"},
    {"noise", "of sensors by the data sheet, of states, of columns"},
    {"only", "rows of derivatives may be named by their operation"},
    {"out", "says what is written"},
    {"part", "windows, curves"},
    {"penalty-form", "published name: of two penalties"},
    {"plot-kind", "which plots there are"},
    {"plant", "errors of derivatives, a machine"},
    {"plot", "says what is drawn"},
    {"points", "of a trajectory, of a curve, of each trajectory"},
    {"preset", "of one method of lg-anomaly train"},
    {"resume", "a checkpoint, or the table of a search"},
    {"runs", "recordings at sea, runs of a machine"},
    {"scheme", "of the exported step, of a simulation"},
    {"seconds", "of a training, of a demo"},
    {"size", "widths of one network, or of all networks of a machine"},
    {"starts", "where predictions start, where members start"},
    {"stop-after", "epochs, runs of a study"},
    {"stride", "of convolutions, of windows"},
    {"t-end", "of a trajectory, of a demo, of each run"},
    {"task", "of a sweep, of an ensemble"},
    {"test", "what is then trained on"},
    {"test-fraction", "of windows, of curves"},
    {"validation", "a part of the data, or logs"},
    {"votes", "of a watch, of recordings"},
    {"window", "seconds of a feed, rows of a log"},
};

/* Options with one description whose default or range differs between commands. */
static const char *const defaults[][2] = {
    {"adam-eps", "presets"},
    {"clip", "presets"},
    {"hop", "baseline alone has another"},
    {"integrator", "families, machines"},
    {"lr", "presets"},
    {"lr-gamma", "presets"},
    {"lr-step", "presets"},
    {"patience", "presets"},
    {"prior", "presets"},
    {"schedule", "presets"},
    {"shards", "presets"},
    {"substeps", "of data, of a machine, of its model"},
    {"weight-decay", "presets"},
};

typedef struct option {
    char name[32], unit[64], meaning[1024], rest[512]; /* rest: range and default */
    bool meanings, defaults;                           /* differ from those of an earlier command */
} option;
static option all[512];
static size_t count;
static char helps[1 << 19]; /* the lines of all options of all commands */

/* Splits "Learning rate of Adam (above 0 to 1000; default 1e-2)" into its two parts. */
static void split(const char *text, option *out) {
    const size_t length = strlen(text);
    size_t at = length;
    for (int open = 0; at > 0 && text[length - 1] == ')' && (at == length || open > 0); at--)
        open += (text[at - 1] == ')') - (text[at - 1] == '(');
    (void)snprintf(out->meaning, sizeof out->meaning, "%.*s", (int)at, text);
    (void)snprintf(out->rest, sizeof out->rest, "%s", text + at);
}

static void add(const option *found) {
    size_t i = 0;
    while (i < count && strcmp(all[i].name, found->name) != 0) i++;
    assert_true(i < LG_COUNT(all));
    if (i == count) all[count++] = *found;
    all[i].meanings = all[i].meanings || strcmp(all[i].unit, found->unit) != 0 ||
                      strcmp(all[i].meaning, found->meaning) != 0;
    all[i].defaults = all[i].defaults || strcmp(all[i].rest, found->rest) != 0;
}

/* Reads the options of one command. "Commands:" ends the help of a program that has commands. */
static void read_options(char *help) {
    char *save = NULL, *end = strstr(help, "Common options:");
    assert_non_null(end);
    *end = '\0';
    for (char *line = strtok_r(help, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save)) {
        option found = {.meanings = false};
        line += strspn(line, " ");
        if (strncmp(line, "--", 2) != 0) continue;
        assert_true(strlen(helps) + strlen(line) + 2 < sizeof helps);
        (void)strcat(strcat(helps, line), "\n");
        char *text = line + strcspn(line, " ");
        if (*text != '\0') *text++ = '\0';
        const size_t name = strcspn(line, "=");
        (void)snprintf(found.name, sizeof found.name, "%.*s", (int)name - 2, line + 2);
        (void)snprintf(found.unit, sizeof found.unit, "%s", line + name);
        split(text + strspn(text, " "), &found);
        assert_true(found.meaning[0] != '\0');
        add(&found);
    }
}

static void read_program(const char *program) {
    static char list[CLI_TEXT];
    char words[64], *save = NULL;
    cli_expect(program, "--help", 0, "Common options:");
    const char *commands = strstr(result.out, "\nCommands:\n");
    (void)snprintf(list, sizeof list, "%s", commands != NULL ? commands + 11 : "");
    read_options(result.out);
    for (char *line = strtok_r(list, "\n", &save); line != NULL && strncmp(line, "  ", 2) == 0;
         line = strtok_r(NULL, "\n", &save)) {
        (void)snprintf(words, sizeof words, "%.*s --help", (int)strcspn(line + 2, " "), line + 2);
        cli_expect(program, words, 0, "Common options:");
        read_options(result.out);
    }
}

/* The table must list exactly the options that differ. */
static void expect_table(const char *what, const char *const (*table)[2], size_t rows, bool meaning) {
    size_t differ = 0;
    for (size_t i = 0; i < count; i++) {
        const bool differs = meaning ? all[i].meanings : all[i].defaults && !all[i].meanings;
        bool told = false;
        for (size_t k = 0; k < rows; k++) told = told || strcmp(table[k][0], all[i].name) == 0;
        if (differs != told) fail_msg("--%s: %s %s", all[i].name, what, differs ? "differ" : "do not differ");
        differ += differs;
    }
    assert_int_equal(differ, rows);
}

TEST("an option has one unit and meaning in all commands, and one range and default") {
    assert_int_equal(setenv("ARGP_HELP_FMT", "rmargin=8000,opt-doc-col=60", 1), 0);
    DIR *folder = opendir(LG_BIN_DIR);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;)
        if (strncmp(entry->d_name, "lg-", 3) == 0) read_program(entry->d_name);
    (void)closedir(folder);
    cli_expect("lg-simulate", "merge --help", 0, "Common options:");
    read_options(result.out);
    assert_int_equal(unsetenv("ARGP_HELP_FMT"), 0);
    expect_table("unit or meaning", meanings, LG_COUNT(meanings), true);
    expect_table("range or default", defaults, LG_COUNT(defaults), false);
}

/* Whether the help of some command says that this is the option's default. */
static bool help_says(const char *name, const char *value) {
    const char *head = test_text("--%s=", name);
    for (const char *line = helps; *line != '\0'; line += strcspn(line, "\n") + 1) {
        if (strncmp(line, head, strlen(head)) != 0) continue;
        const char *own = test_text("%.*s", (int)strcspn(line, "\n"), line);
        if (strstr(own, test_text("default %s", value)) || strstr(own, test_text("%s (default)", value)))
            return true;
    }
    return false;
}

/* Checks "`--bridge` seconds (default 1)", "`--mirror true` (default in `best`)" and "`--features` ...: `cov`
 * (default)": each "(default" whose option is in the text before it. Returns how many there are. */
static size_t check_page(const char *name, const char *text) {
    size_t found = 0;
    for (const char *at = text; (at = strstr(at, "(default")) != NULL; at++) {
        const char *named = NULL;
        for (const char *back = at; back > text && at - back < 160 && *back != '|'; back--)
            if (named == NULL && strncmp(back, "`--", 3) == 0) named = back + 3;
        if (named == NULL) continue;
        char value[128], word[64];
        (void)snprintf(word, sizeof word, "%.*s", (int)strcspn(named, " `="), named);
        const char *end = at - 1;
        while (end > named && strchr("` \n", end[-1]) != NULL) end--;
        const char *begin = end;
        while (begin > named && strchr("` \n", begin[-1]) == NULL) begin--;
        if (at[8] == ' ' && strncmp(at, "(default in", 11) != 0)
            (void)snprintf(value, sizeof value, "%.*s", (int)strcspn(at + 9, ",;:)"), at + 9);
        else
            (void)snprintf(value, sizeof value, "%.*s", (int)(end - begin), begin);
        if (!help_says(word, value)) fail_msg("%s: --%s: help does not say default %s", name, word, value);
        found++;
    }
    return found;
}

TEST("defaults that docs state after an option are those that help prints") {
    enum { SIZE = 1 << 20 };
    const char *path = test_text("%s/../docs", LG_TEST_DIR);
    char *text = lg_test_memory(SIZE);
    size_t found = 0;
    DIR *folder = opendir(path);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        if (strstr(entry->d_name, ".md") == NULL) continue;
        FILE *file = fopen(test_text("%s/%s", path, entry->d_name), "r");
        assert_non_null(file);
        text[fread(text, 1, SIZE - 1, file)] = '\0';
        (void)fclose(file);
        found += check_page(entry->d_name, text);
    }
    (void)closedir(folder);
    assert_true(found > 5);
}

static int setup(void **state) {
    return cli_begin();
}

TEST_GROUP(setup, cli_end)
