/* Checks that an option has the same meaning in all commands of all programs. Reads the options from
 * --help-all. */
#include "cli_support.h"
#include "model/files/training.h"

/* Options whose unit or description differs between commands, and why. */
static const char *const meanings[][2] = {
    {"activation", "of hidden layers, or between layers and of all layers of a cnn"},
    {"batch", "its samples are trajectories, curves, windows, rows"},
    {"case", "a train of lg-elastica generate has both"},
    {"crack-at", "hours of a feed, or seconds of a trial with a known truth"},
    {"dtype", "of training, of the code, of a measurement, of a proof"},
    {"epochs", "a total, or evaluations of a demo"},
    {"hidden", "one width for all layers, or a list"},
    {"hop", "seconds of a feed, rows of a log"},
    {"hours", "of a recording, of a feed"},
    {"initial-states", "of trajectories, of logs"},
    {"jobs", "trials, runs of a study"},
    {"loss", "the losses of detectors and surrogates"},
    {"metric", "over trajectories, over parts"},
    {"noise", "of sensors by the data sheet, of states, of columns"},
    {"only", "rows of derivatives may be named by their operation"},
    {"out", "says what is written"},
    {"part", "windows, curves"},
    {"penalty", "weight of a penalty in the loss"},
    {"penalty-form", "published or text: of this penalty"},
    {"plot-kind", "which plots there are"},
    {"plot", "says what is drawn"},
    {"points", "of a trajectory, of a curve, of each trajectory"},
    {"preset", "of one method of lg-anomaly train"},
    {"resume", "the options of a controller's training are given again"},
    {"runs", "recordings at sea, runs of a machine"},
    {"scheme", "of the exported step, of a simulation"},
    {"seconds", "of a training, of a demo"},
    {"size", "widths of one network, or of all networks of a machine"},
    {"stop-after", "epochs, runs of a study"},
    {"t-end", "of a trajectory, of a demo, of each run"},
    {"task", "of a sweep, of an ensemble"},
    {"test", "what is then trained on"},
    {"test-fraction", "of windows, of curves"},
    {"tolerance", "of a learned flow, of a simulation"},
    {"validation-fraction", "of a training, of the trials of a search"},
    {"votes", "of a watch, of recordings"},
    {"window", "seconds of a feed, rows of a log"},
};

/* Options with one description whose default or range differs between commands. */
static const char *const defaults[][2] = {
    {"adam-eps", "presets"},     {"architecture", "presets"},
    {"clip", "presets"},         {"lr", "presets"},
    {"lr-gamma", "presets"},     {"lr-step", "presets"},
    {"optimizer", "presets"},    {"patience", "presets"},
    {"prior", "presets"},        {"schedule", "presets"},
    {"shards", "presets"},       {"substeps", "of data, of a machine, of its model"},
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
    for (size_t k = 0; k < count; k++)
        if (k != i && strcmp(all[k].meaning, found->meaning) == 0)
            fail_msg("--%s and --%s have one meaning: %s", all[k].name, found->name, found->meaning);
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
    cli_expect(program, "--help-all", 0, "Common options:");
    const char *commands = strstr(result.out, "\nCommands:\n");
    (void)snprintf(list, sizeof list, "%s", commands != NULL ? commands + 11 : "");
    read_options(result.out);
    for (char *line = strtok_r(list, "\n", &save); line != NULL && strncmp(line, "  ", 2) == 0;
         line = strtok_r(NULL, "\n", &save)) {
        (void)snprintf(words, sizeof words, "%.*s --help-all", (int)strcspn(line + 2, " "), line + 2);
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
    cli_expect("lg-simulate", "merge --help-all", 0, "Common options:");
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

/* ---- the usual options ---- */

enum { USUAL = 12, COMMAND = 64 };

/* The options of a command, separated by blanks, as `help` (--help or --help-all) lists them. Returns how
 * many. */
static size_t list_options(const char *program, const char *verb, const char *help, char *out, size_t size) {
    size_t found = 0;
    char *save = NULL;
    cli_expect(program, test_text("%s %s", verb, help), 0, "Common options:");
    strstr(result.out, "Common options:")[0] = '\0';
    (void)snprintf(out, size, " ");
    for (char *line = strtok_r(result.out, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save)) {
        line += strspn(line, " ");
        if (strncmp(line, "--", 2) != 0) continue;
        line[strcspn(line, "= ")] = '\0';
        assert_true(strlen(out) + strlen(line) + 2 < size);
        (void)strcat(strcat(out, line), " ");
        found++;
    }
    return found;
}

/* Calls each(program, verb) for all programs and verbs; of lg-learn train for all recipes, too. */
static void for_each_command(void (*each)(const char *, const char *)) {
    static char list[CLI_TEXT];
    char verb[COMMAND];
    DIR *folder = opendir(LG_BIN_DIR);
    assert_non_null(folder);
    assert_int_equal(setenv("ARGP_HELP_FMT", "rmargin=8000,opt-doc-col=60", 1), 0);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        char *save = NULL;
        if (strncmp(entry->d_name, "lg-", 3) != 0 || strcmp(entry->d_name, "lg-bench") == 0) continue;
        cli_expect(entry->d_name, "--help", 0, "Common options:");
        const char *commands = strstr(result.out, "\nCommands:\n");
        (void)snprintf(list, sizeof list, "%s", commands != NULL ? commands + 11 : "");
        if (commands == NULL) each(entry->d_name, "");
        for (char *line = strtok_r(list, "\n", &save); line != NULL && strncmp(line, "  ", 2) == 0;
             line = strtok_r(NULL, "\n", &save)) {
            line += 2;
            line[strcspn(line, " ")] = '\0';
            each(entry->d_name, line);
        }
    }
    (void)closedir(folder);
    for (const lg_recipe *const *recipe = lg_recipes; *recipe != NULL; recipe++) {
        (void)snprintf(verb, sizeof verb, "train --recipe %s", (*recipe)->name);
        each("lg-learn", verb);
    }
    assert_int_equal(unsetenv("ARGP_HELP_FMT"), 0);
}

static size_t shortened;

static void check_usual(const char *program, const char *verb) {
    static char usual[8192], all_of_them[8192];
    const size_t shown = list_options(program, verb, "--help", usual, sizeof usual),
                 total = list_options(program, verb, "--help-all", all_of_them, sizeof all_of_them);
    char *save = NULL;
    if (shown > USUAL || (total <= USUAL && shown < total) || (total > USUAL && shown < USUAL / 2))
        fail_msg("%s %s --help lists %zu of %zu options", program, verb, shown, total);
    for (char *word = strtok_r(usual, " ", &save); word != NULL; word = strtok_r(NULL, " ", &save))
        if (strstr(all_of_them, test_text(" %s ", word)) == NULL)
            fail_msg("%s %s: --help-all does not list %s", program, verb, word);
    shortened += shown < total;
    cli_expect(program, test_text("%s --help", verb), 0, "--help-all");
}

TEST("--help lists at most twelve options of a command and the common ones, --help-all lists all") {
    for_each_command(check_usual);
    assert_true(shortened > 5);
}

/* ---- old spellings ---- */

typedef struct alias {
    char command[COMMAND], old[32], now[32], value[32];
    bool used;
} alias;
static alias aliases[64];
static size_t alias_count;

/* Reads the rows of apps/common/aliases.c. */
static void read_aliases(void) {
    char line[256];
    FILE *file = fopen(test_text("%s/../apps/common/aliases.c", LG_TEST_DIR), "r");
    assert_non_null(file);
    while (fgets(line, sizeof line, file) != NULL) {
        alias row = {.used = false};
        const char *at = strstr(line, "{\"");
        if (at == NULL) continue;
        const bool every =
            sscanf(at, "{\"\", \"%31[^\"]\", \"%31[^\"]\", %31[^}]", row.old, row.now, row.value) == 3;
        if (!every && sscanf(at, "{\"%63[^\"]\", \"%31[^\"]\", \"%31[^\"]\", %31[^}]", row.command, row.old,
                             row.now, row.value) != 4)
            continue;
        assert_true(alias_count < LG_COUNT(aliases));
        aliases[alias_count++] = row;
    }
    assert_int_equal(fclose(file), 0);
}

/* Returns the command's message about this option with an empty value, which every option rejects. `alone`:
 * the option takes no value; then a wrong --seed follows, and the message is about --seed. */
static const char *answer(const char *program, const char *verb, const char *name, bool alone) {
    cli_run_limited(program, test_text(alone ? "%s --%s --seed=x" : "%s --%s=", verb, name), 0);
    if (strstr(result.err, "allow an argument") != NULL && !alone) return answer(program, verb, name, true);
    if (strstr(result.err, "unrecognized") != NULL) fail_msg("%s %s has no --%s", program, verb, name);
    return test_text("%d %s", result.code, result.err);
}

/* The first row that fits a command says what the old spelling means there. */
static void check_aliases(const char *program, const char *verb) {
    static char options[8192];
    char title[COMMAND], before[1024];
    (void)snprintf(title, sizeof title, "%s%s%.*s", program, verb[0] != '\0' ? " " : "",
                   (int)strcspn(verb, " "), verb);
    (void)list_options(program, verb, "--help-all", options, sizeof options);
    for (size_t i = 0; i < alias_count; i++) {
        alias *row = &aliases[i];
        bool first = true;
        const bool fits = strncmp(title, row->command, strlen(row->command)) == 0,
                   has_old = strstr(options, test_text(" --%s ", row->old)) != NULL,
                   has_new = strstr(options, test_text(" --%s ", row->now)) != NULL;
        for (size_t k = 0; k < i; k++)
            first = first && !(strcmp(aliases[k].old, row->old) == 0 &&
                               strncmp(title, aliases[k].command, strlen(aliases[k].command)) == 0 &&
                               strstr(options, test_text(" --%s ", aliases[k].now)) != NULL);
        if (!fits || has_old || !has_new || !first) continue;
        const bool fixed = strcmp(row->value, "NULL") != 0;
        (void)snprintf(before, sizeof before, "%s", answer(program, verb, row->old, fixed));
        const char *now =
            fixed ? test_text("%s=%.*s", row->now, (int)strcspn(row->value + 1, "\""), row->value + 1)
                  : row->now;
        if (strcmp(before, answer(program, verb, now, fixed)) != 0)
            fail_msg("%s --%s says: %s\n--%s says: %s", title, row->old, before, now,
                     answer(program, verb, now, fixed));
        row->used = true;
    }
}

TEST("an old spelling is parsed as the new one, and --help-all does not list it") {
    read_aliases();
    assert_true(alias_count > 10);
    for_each_command(check_aliases);
    for (size_t i = 0; i < alias_count; i++)
        if (!aliases[i].used) fail_msg("no command has --%s for --%s", aliases[i].now, aliases[i].old);
}

static int setup(void **state) {
    return cli_begin();
}

TEST_GROUP(setup, cli_end)
