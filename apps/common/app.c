/* Commands, the parser that is built from option tables, the context and signals. */
#include "common/app.h"

#include <argp.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "files/temporary.h"
#include "model/files/training.h"

enum { KEY_HELP_ALL = 0x800, KEY_COMMON = 0x1000, KEY_COMMAND = 0x2000, KEY_SWITCH = 0x3000 };

/* number of the first signal that asked the program to end; 0: there was none */
static volatile int stopped_by;
static volatile sig_atomic_t hung_up;
static app *running; /* for --version, app_out_of_memory and app_end */
static bool parsing; /* the command line is being parsed; --help and --version call exit meanwhile */

app_common app_common_given;

static const lg_field common_options[] = {
    LG_OPTION(app, json, SWITCH, NULL, "Print the result as one JSON object"),
    LG_OPTION(app, seed, U64, "S", "Seed of all random numbers (default 1)", .high = 0x1p64),
    LG_OPTION(app, threads, U64, "T",
              "Number of threads (default: all processors); results do not depend on it", .low = 1,
              .high = 256),
    LG_FIELD_END};

void app_out_of_memory(void) {
    if (running != NULL)
        app_say_as_rank(running, "out of memory");
    else
        (void)fputs("liegrad: out of memory\n", stderr);
    exit(APP_EXIT_MEMORY);
}

const app *app_running(void) {
    return running;
}

bool app_interrupted(void) {
    return stopped_by != 0;
}

const char *app_stopper(void) {
    return stopped_by == SIGTERM ? "SIGTERM" : stopped_by == SIGHUP ? "SIGHUP" : "Ctrl-C";
}

/* ---- the options of a command ---- */

static void add_settings(app *self, const app_settings *settings) {
    if (settings->size > 0) memset(settings->values, 0, settings->size);
    lg_fields_default(settings->rows, settings->values);
    for (const lg_field *row = settings->rows; row->name != NULL; row++) {
        app_slot slot = {.row = row, .values = settings->values};
        lg_field_option(row, slot.name, sizeof slot.name);
        if (slot.name[0] == '\0') continue;
        if (self->slot_count == APP_SLOTS) abort(); /* the tables of the command have too many rows */
        self->slots[self->slot_count++] = slot;
    }
}

void app_choose_command(app *self, const app_command *command) {
    self->command = command;
    self->slot_count = 0;
    const app_settings *settings = command->settings;
    for (; settings != NULL && settings->rows != NULL; settings++) add_settings(self, settings);
}

/* The command of the command line. */
static void begin_command(app *self, const app_command *command) {
    app_choose_command(self, command);
    if (command->plots != NULL)
        add_settings(self, &(app_settings){app_plot_options(command->plots), &app_plot_given, 0});
}

lg_status app_store(app_slot *slot, const char *text, lg_error *error) {
    const lg_status status = lg_field_set(slot->row, text, slot->values, error);
    slot->given = slot->given || status == LG_OK;
    return status;
}

static app_slot *slot_named(const app *self, const char *option) {
    for (size_t i = 0; i < self->slot_count; i++)
        if (strcmp(self->slots[i].name, option) == 0) return (app_slot *)(uintptr_t)&self->slots[i];
    return NULL;
}

/* The option that this old spelling means for the command; NULL: none. */
static app_slot *slot_of_alias(const app *self, const app_alias *alias) {
    const bool here = strncmp(self->title, alias->command, strlen(alias->command)) == 0;
    return here && slot_named(self, alias->old) == NULL ? slot_named(self, alias->now) : NULL;
}

app_slot *app_find_slot(const app *self, const char *option) {
    app_slot *found = slot_named(self, option);
    for (const app_alias *at = app_aliases; found == NULL && at->old != NULL; at++)
        if (strcmp(at->old, option) == 0) found = slot_of_alias(self, at);
    return found;
}

bool app_given(const app *self, const char *option) {
    const app_slot *slot = app_find_slot(self, option);
    return slot != NULL && slot->given;
}

/* ---- argp parsers from tables of options ---- */

/* A command with more options than MANY shows only the usual ones in --help. */
enum { COMMON = LG_COUNT(common_options) - 1, HELP_SIZE = 2048, MANY = 12 };

/* `text` has HELP_SIZE bytes. */
static struct argp_option argp_row(const lg_field *row, const char *name, int key, int group, char *text) {
    const bool alone = row->type == LG_FIELD_SWITCH;
    (void)lg_training_describe_field(row, text, HELP_SIZE);
    return (struct argp_option){name, key,  alone ? NULL : row->unit != NULL ? row->unit : "NAME",
                                0,    text, group};
}

/* `texts` has HELP_SIZE bytes for each option of the command and for each common option. */
static struct argp_option *argp_table(const app *self, char *texts) {
    const size_t n = self->slot_count;
    size_t aliases = 0;
    while (app_aliases[aliases].old != NULL) aliases++;
    struct argp_option *out = app_alloc(n + COMMON + aliases + 3, sizeof *out), *at = out;
    for (size_t i = 0; i < n; i++, texts += HELP_SIZE) {
        *at = argp_row(self->slots[i].row, self->slots[i].name, KEY_COMMAND + (int)i, 1, texts);
        if (n > MANY && !self->help_all && !self->slots[i].row->usual) at->flags = OPTION_HIDDEN;
        at++;
    }
    for (size_t i = 0; i < aliases; i++) {
        const app_slot *slot = slot_of_alias(self, &app_aliases[i]);
        if (slot == NULL) continue;
        *at = out[slot - self->slots];
        at->name = app_aliases[i].old;
        at->flags = OPTION_HIDDEN;
        if (app_aliases[i].value != NULL) at->key = KEY_SWITCH + (int)i, at->arg = NULL;
        at++;
    }
    *at++ = (struct argp_option){NULL, 0, NULL, 0, "Common options:", 2};
    for (size_t i = 0; i < COMMON; i++, texts += HELP_SIZE)
        *at++ = argp_row(&common_options[i], common_options[i].name, KEY_COMMON + (int)i, 2, texts);
    *at = (struct argp_option){"help-all", KEY_HELP_ALL, NULL, 0, "Give the list of all options", -1};
    return out;
}

/* The words are shown, since they hold those of the command line. */
static void complain(const struct argp_state *state, char *words) {
    argp_error(state, "%s", words);
    free(words);
}

static void store(const struct argp_state *state, app_slot *slot, const char *text) {
    lg_error error = {LG_OK, ""};
    if (app_store(slot, text, &error) != LG_OK)
        complain(state, app_words("--%s: %s", slot->name, error.message));
}

static error_t parse_option(int key, char *text, struct argp_state *state, app *self) {
    if (key >= KEY_COMMAND && key < KEY_COMMAND + (int)self->slot_count) {
        store(state, &self->slots[key - KEY_COMMAND], text);
        return 0;
    }
    if (key >= KEY_COMMON && key < KEY_COMMAND) {
        app_slot slot = {.row = &common_options[key - KEY_COMMON], .values = self};
        (void)snprintf(slot.name, sizeof slot.name, "%s", slot.row->name);
        store(state, &slot, text);
        if (strcmp(slot.name, "seed") == 0) self->seed_given = true;
        return 0;
    }
    if (key >= KEY_SWITCH && key < 2 * KEY_SWITCH) {
        const app_alias *alias = &app_aliases[key - KEY_SWITCH];
        app_slot *slot = slot_named(self, alias->now);
        char value[LG_FIELD_TEXT_SIZE];
        lg_field_show(slot->row, slot->values, value, sizeof value);
        if (slot->given && strcmp(value, alias->value) != 0)
            complain(state, app_words("--%s: --%s is already %s: give one of the two", alias->old, alias->now,
                                      value));
        store(state, slot, alias->value);
        return 0;
    }
    if (key != KEY_HELP_ALL) return ARGP_ERR_UNKNOWN;
    argp_state_help(state, stdout, ARGP_HELP_STD_HELP);
    return 0;
}

/* Reads from the usage text how many arguments a command takes; `|` separates alternatives. */
static void count_arguments(const char *usage, int *least, int *most) {
    int needed = 0, possible = 0;
    *least = usage != NULL ? APP_ARGUMENTS : 0;
    *most = 0;
    for (const char *word = usage; word != NULL; word += strspn(word, " ")) {
        const size_t n = strcspn(word, " ");
        const bool end = n == 0 || word[0] == '|', many = n >= 3 && strncmp(word + n - 3, "...", 3) == 0;
        if (!end && word[0] != '[' && n > (many ? 3 : 0)) needed++;
        if (!end) possible = many ? APP_ARGUMENTS : possible + 1;
        if (end && needed < *least) *least = needed;
        if (end && possible > *most) *most = possible;
        if (end) needed = possible = 0;
        if (n == 0) return;
        word += n;
    }
}

static error_t parse_command(int key, char *text, struct argp_state *state) {
    app *self = state->input;
    const app_command *command = self->command;
    int least, most;
    count_arguments(command->arguments, &least, &most);
    switch (key) {
    case ARGP_KEY_ARG:
        if (self->argument_count >= most)
            complain(state, app_words("too many arguments: '%s'; expected: %s", text,
                                      command->arguments != NULL ? command->arguments : "none"));
        self->arguments[self->argument_count++] = text;
        return 0;
    case ARGP_KEY_END:
        if (self->argument_count < least)
            argp_error(state, "missing argument; expected: %s", command->arguments);
        return 0;
    default:
        return parse_option(key, text, state, self);
    }
}

static void run_parser(app *self, int argc, char **argv) {
    APP_FREE char *texts = app_alloc(self->slot_count + COMMON, HELP_SIZE);
    APP_FREE struct argp_option *options = argp_table(self, texts);
    APP_FREE char *doc =
        app_format("%s%s%s", self->command->summary, self->command->details != NULL ? "\v" : "",
                   self->command->details != NULL ? self->command->details : "");
    const struct argp argp = {options, parse_command, self->command->arguments, doc, NULL, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, self);
}

typedef struct dispatch {
    app *self;
    const app_command *commands;
} dispatch;

static char *command_names(const app_command *commands) {
    lg_text names = app_text();
    for (const app_command *c = commands; c->run != NULL; c++)
        lg_text_add(&names, "%s%s", c == commands ? "" : ", ", c->name);
    return names.data;
}

/* The first word that is not an option names the command, and this command's parser takes the rest. */
static error_t parse_top(int key, char *text, struct argp_state *state) {
    dispatch *d = state->input;
    if (key == ARGP_KEY_NO_ARGS) {
        APP_FREE char *names = command_names(d->commands);
        argp_error(state, "a command is missing; commands: %s", names);
    }
    if (key != ARGP_KEY_ARG) return parse_option(key, text, state, d->self);
    for (const app_command *c = d->commands; c->run != NULL; c++) {
        if (strcmp(c->name, text) != 0) continue;
        begin_command(d->self, c);
        (void)snprintf(d->self->title, sizeof d->self->title, "%s %s", d->self->program, c->name);
        const int first = state->next - 1;
        char *word = state->argv[first];
        state->argv[first] = d->self->title;
        run_parser(d->self, state->argc - first, state->argv + first);
        state->argv[first] = word;
        state->next = state->argc;
        return 0;
    }
    APP_FREE char *names = command_names(d->commands);
    complain(state, app_words("'%s' is not a command; the commands are: %s", text, names));
    return ARGP_ERR_UNKNOWN;
}

static void parse_with_commands(app *self, int argc, char **argv, const char *summary,
                                const app_command *commands) {
    size_t widest = 0;
    for (const app_command *c = commands; c->run != NULL; c++)
        if (strlen(c->name) > widest) widest = strlen(c->name);
    APP_CLEAN(lg_text_destroy) lg_text doc = app_text();
    lg_text_add(&doc, "%s\vCommands:\n", summary);
    for (const app_command *c = commands; c->run != NULL; c++)
        lg_text_add(&doc, "  %-*s  %s\n", (int)widest, c->name, c->summary);
    lg_text_add(&doc,
                "\n%s COMMAND --help describes the options of a command. --help-all describes all of them.",
                self->program);
    char texts[COMMON * HELP_SIZE];
    APP_FREE struct argp_option *options = argp_table(self, texts);
    const struct argp argp = {options, parse_top, "COMMAND ...", doc.data, NULL, NULL, NULL};
    dispatch d = {self, commands};
    (void)argp_parse(&argp, argc, argv, ARGP_IN_ORDER, NULL, &d);
}

static void print_version(FILE *stream, struct argp_state *state) {
    (void)fprintf(stream, "%s (liegrad) %s\n", running->program, lg_version());
}

/* ---- running a command ---- */

/* Checks that stdout took everything that was printed. Returns an exit code. */
static int flush_output(const app *self) {
    if (app_screen_flush()) return APP_EXIT_OK;
    return app_fail(self, LG_FILE, "the results could not be written to standard output");
}

/* atexit handler: checks the output of --help, --usage and --version, after which argp calls exit(0). */
static void flush_help(void) {
    const int code = parsing ? flush_output(running) : APP_EXIT_OK;
    if (code != APP_EXIT_OK) _exit(code);
}

/* Handler of the signals that end a command after its state is saved; the same signal a second time kills. If
 * SIGHUP was ignored at the start (nohup), it stays ignored. */
static void on_stop(int number) {
    if (stopped_by == 0) stopped_by = number;
}

static void handle(int number, void (*handler)(int number), int flags) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = handler;
    action.sa_flags = flags;
    (void)sigaction(number, &action, NULL);
}

static void install_signals(void) {
    static const int stops[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction before;
    for (size_t i = 0; i < LG_COUNT(stops); i++) {
        const bool known = sigaction(stops[i], NULL, &before) == 0;
        if (stops[i] == SIGHUP && known && before.sa_handler == SIG_IGN) continue;
        handle(stops[i], on_stop, SA_RESTART | (int)SA_RESETHAND);
    }
    handle(SIGXFSZ, SIG_IGN, 0);
    handle(SIGPIPE, SIG_IGN, 0);
}

static void on_hangup(int number) {
    hung_up = 1;
}

void app_reopen_on_hangup(void) {
    handle(SIGHUP, on_hangup, SA_RESTART);
}

bool app_reopen_asked(void) {
    if (hung_up == 0) return false;
    hung_up = 0;
    return true;
}

static void on_log(void *user, lg_log_level level, const char *message) {
    const app *self = user;
    if (level == LG_LOG_WARNING)
        app_warn(self, "%s", message);
    else if (level != LG_LOG_DEBUG)
        app_note(self, "%s%s", level == LG_LOG_ERROR ? "error: " : "", message);
}

/* ---- limited memory ---- */

static bool is_limited(void) {
    static const int resources[] = {RLIMIT_AS, RLIMIT_DATA};
    struct rlimit limit;
    bool limited = false;
    for (size_t i = 0; i < LG_COUNT(resources); i++)
        limited = limited || (getrlimit(resources[i], &limit) == 0 && limit.rlim_cur != RLIM_INFINITY);
    return limited;
}

/* When OpenBLAS is loaded it starts threads, and under a memory limit each retries its allocation forever. So
 * the program executes itself again with OPENBLAS_NUM_THREADS=1, so that OpenBLAS starts no threads. */
static void begin_without_threads(char **argv) {
    if (!is_limited() || getenv("OPENBLAS_NUM_THREADS") != NULL) return;
    if (setenv("OPENBLAS_NUM_THREADS", "1", 1) == 0) (void)execv("/proc/self/exe", argv);
}

/* If stdin, stdout or stderr is closed, the next file that is opened would get its descriptor and be read or
 * written in its place. So /dev/null is opened there in the opposite direction: using the stream still fails,
 * as it does for a closed one. */
static void keep_standard_places(void) {
    static const int directions[] = {O_WRONLY, O_RDONLY, O_RDONLY};
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++) /* open takes the lowest free descriptor, fd */
        if (fcntl(fd, F_GETFD) < 0) (void)open("/dev/null", directions[fd]);
}

static void reserve(const app *self) {
    if (!is_limited() || lg_runtime_reserve((int)self->threads)) return;
    app_stop(self, LG_OUT_OF_MEMORY,
             "out of memory: the limit on addresses (ulimit -v) leaves less than the %llu MiB that "
             "%llu thread%s of OpenBLAS may use: raise the limit, or reduce --threads",
             (unsigned long long)self->threads * 128, (unsigned long long)self->threads,
             self->threads == 1 ? "" : "s");
}

static const char *text_of(const app_slot *slot) {
    return *(const char *const *)((const char *)slot->values + slot->row->offset);
}

size_t app_file_options(const app *self, app_path *paths) {
    size_t count = 0;
    for (size_t i = 0; i < self->slot_count; i++) {
        const app_slot *slot = &self->slots[i];
        if (slot->row->type != LG_FIELD_STRING || slot->row->file == LG_FILE_NOT) continue;
        const char *text = text_of(slot), *bar = strchr(slot->row->unit, '|');
        /* Where the unit ends in |-, "-" means standard output. */
        const bool out = text != NULL && strcmp(text, "-") == 0 && bar != NULL && strcmp(bar, "|-") == 0;
        paths[count++] = (app_path){slot->name, out ? NULL : text, slot->row->file, slot->row->kind};
    }
    return count;
}

void app_read_options(const app *self) {
    char text[LG_FIELD_TEXT_SIZE], *save = NULL;
    for (size_t i = 0; i < self->slot_count; i++) {
        const lg_field *row = self->slots[i].row;
        if (row->file != LG_FILE_READ) continue;
        lg_field_show(row, self->slots[i].values, text, sizeof text);
        for (char *at = strtok_r(text, ",", &save); at != NULL; at = strtok_r(NULL, ",", &save))
            if (row->type == LG_FIELD_STRING || strpbrk(at, "./") != NULL) app_reads(self, at); /* no name */
    }
}

/* Checks that required options are given, texts or numbers; the default of a text counts. */
static void check_required(const app *self, bool texts) {
    for (const app_slot *slot = self->slots; slot < self->slots + self->slot_count; slot++) {
        const bool text = slot->row->type == LG_FIELD_STRING;
        if (slot->row->required && text == texts && (text ? text_of(slot) == NULL : !slot->given))
            app_stop_usage(self, "--%s %s is missing", slot->name, slot->row->unit);
    }
}

/* Checks options that need or exclude each other. */
static void check_together(const app *self) {
    for (const app_slot *slot = self->slots; slot < self->slots + self->slot_count; slot++) {
        if (!slot->given) continue;
        const app_slot *other = slot->row->needs != NULL ? app_find_slot(self, slot->row->needs) : slot;
        if (!other->given)
            app_stop_usage(self, "--%s: needs --%s%s%s", slot->name, other->name,
                           other->row->unit != NULL ? " " : "",
                           other->row->unit != NULL ? other->row->unit : "");
        APP_FREE char *others = app_format("%s", slot->row->without != NULL ? slot->row->without : "");
        for (char *save = NULL, *at = strtok_r(others, ",", &save); at != NULL;
             at = strtok_r(NULL, ",", &save))
            if (app_given(self, at))
                app_stop_usage(self, "--%s and --%s cannot be given together", slot->name, at);
    }
}

/* Called after the command, however it ended. */
static int conclude(app *self, int code) {
    code = app_leave_ranks(self, code);
    if (code == APP_EXIT_OK) code = flush_output(self);
    return code == APP_EXIT_INTERRUPTED && stopped_by != 0 ? 128 + stopped_by : code;
}

void app_end(int code) {
    exit(running != NULL ? conclude(running, code) : code);
}

static int run_command(app *self) {
    lg_context_options options;
    app_json out;
    lg_context_options_init(&options);
    options.log = on_log;
    options.log_user = self;
    options.cancel = &stopped_by;
    options.replace = app_may_replace;
    options.replace_user = self;
    app_must(self, lg_context_create(&options, &self->context), NULL);
    app_join_ranks(self);
    check_required(self, true);
    app_check_outputs(self, NULL, 0);
    check_required(self, false);
    check_together(self);
    app_result_begin(&out, self);
    self->out = &out;
    self->command->run(self);
    app_result_end(self);
    const int code = conclude(self, self->code);
    lg_context_destroy(self->context);
    return code;
}

int app_main(int argc, char **argv, const char *program, const char *summary, const app_command *commands) {
    keep_standard_places();
    begin_without_threads(argv);
    app_screen_begin();
    app self = {.program = program, .seed = 1, .threads = app_processors()};
    (void)snprintf(self.title, sizeof self.title, "%s", program);
    running = &self;
    app_find_ranks(&self);
    argp_err_exit_status = APP_EXIT_USAGE;
    argp_program_version_hook = print_version;
    lg_text words = app_text();
    for (int i = 0; i < argc; i++) {
        if (i > 0) lg_text_add(&words, " ");
        lg_text_add_word(&words, argv[i]);
    }
    self.command_line = words.data;
    argv[0] = self.title; /* getopt begins its messages with it */
    install_signals();
    for (int i = 1; i < argc; i++) self.help_all = self.help_all || strncmp(argv[i], "--help-", 7) == 0;
    for (int i = 1; i < argc; i++) /* getopt would print the lines of such a word */
        if (strncmp(argv[i], "--", 2) == 0 && strcspn(argv[i], "\n\t") < strcspn(argv[i], "="))
            app_stop_usage(&self, "unrecognized option '%s'", argv[i]);
    parsing = atexit(flush_help) == 0;
    (void)atexit(lg_temporary_remove_all);
    if (commands[0].name == NULL) {
        begin_command(&self, &commands[0]);
        run_parser(&self, argc, argv);
    } else {
        parse_with_commands(&self, argc, argv, summary, commands);
    }
    parsing = false;
    lg_runtime_setup();
    lg_io_setup();
    reserve(&self);
    const int code = run_command(&self);
    free(self.command_line);
    app_free_kept();
    running = NULL;
    return code;
}
