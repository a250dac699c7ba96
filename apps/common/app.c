/* Commands, the parser built from option tables, the context, signals. */
#include "common/app.h"

#include <argp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { KEY_COMMON = 0x1000, KEY_COMMAND = 0x2000 };

static volatile int interrupted;
static const app *running; /* for --version and the last words */

static const app_option common_options[] = {
    APP_ROW_FLAG(app, json, "json", "Print the result as one JSON object"),
    APP_ROW_SIZE(app, seed, "seed", "S", 0, 0x1p64, "Seed of all random numbers (default 1)"),
    APP_ROW_SIZE(app, threads, "threads", "T", 1, 256,
                 "Threads (default: the processors there are); results do not depend on it"),
    APP_ROW_END};

void app_out_of_memory(void) {
    (void)fprintf(stderr, "%s: out of memory\n", running != NULL ? running->title : "liegrad");
    exit(APP_EXIT_MEMORY);
}

bool app_interrupted(void) {
    return interrupted != 0;
}

/* ---- one option ---- */

/* The fewest digits, 15 or 17, that give the number back. */
static void bound_text(double bound, char out[32]) {
    (void)snprintf(out, 32, "%.15g", bound);
    if (strtod(out, NULL) != bound) (void)snprintf(out, 32, "%.17g", bound);
}

/* Whether a number of the list (or the only one) is beyond the upper bound. */
static bool exceeds(const app_option *option, const char *text) {
    for (char *end;; text = end + 1) {
        const double value = strtod(text, &end);
        if (value > option->high || (option->high == 0x1p64 && value >= option->high)) return true;
        if (end == text || *end != ',') return false;
    }
}

/* What the option takes. Bounds that stand for none are named only where `text` is beyond them. */
static void range_text(const app_option *option, const char *text, char *out, size_t size) {
    const bool whole = option->kind == APP_SIZE || option->kind == APP_SIZES;
    const bool low = option->low > -1e300, high = option->high < 0x1p63 || exceeds(option, text);
    char bound[32];
    size_t used = (size_t)snprintf(out, size, "%s", whole ? "a whole number" : "a number");
    bound_text(option->low, bound);
    if (low)
        used += (size_t)snprintf(out + used, size - used, " %s %s", option->above ? "above" : "of at least",
                                 bound);
    bound_text(option->high, bound);
    if (high && option->high == 0x1p64)
        (void)snprintf(out + used, size - used, " and below 2^64");
    else if (high)
        (void)snprintf(out + used, size - used, " %s %s", low ? "and at most" : "of at most", bound);
}

static bool in_range(const app_option *option, double value) {
    return (option->above ? value > option->low : value >= option->low) && value <= option->high;
}

static bool all_in_range(const app_option *option, const app_reals *list, bool whole) {
    for (size_t i = 0; i < list->count; i++)
        if (!in_range(option, list->values[i]) ||
            (whole && list->values[i] != (double)(uint32_t)list->values[i]))
            return false;
    return true;
}

static bool store_number(const app_option *option, const char *text, void *target) {
    double real;
    uint64_t size;
    if (option->kind == APP_SIZE) {
        if (!app_parse_size(text, &size) || !in_range(option, (double)size)) return false;
        *(uint64_t *)target = size;
    } else {
        if (!app_parse_real(text, &real) || !in_range(option, real)) return false;
        *(double *)target = real;
    }
    return true;
}

static bool store_list(const app_option *option, const char *text, void *target) {
    app_reals list;
    const bool whole = option->kind == APP_SIZES;
    if (!app_parse_reals(text, &list) || !all_in_range(option, &list, whole)) return false;
    if (!whole) {
        *(app_reals *)target = list;
        return true;
    }
    app_sizes *sizes = target;
    sizes->count = list.count;
    for (size_t i = 0; i < list.count; i++) sizes->values[i] = (uint32_t)list.values[i];
    return true;
}

static void refuse_choice(const app_option *option, const char *text, char *message, size_t size) {
    char names[512] = "";
    for (size_t i = 0, used = 0; option->choices[i] != NULL && used < sizeof names; i++)
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", i > 0 ? ", " : "",
                                 option->choices[i]);
    (void)snprintf(message, size, "'%s' is not one of %s", text, names);
}

static void refuse_number(const app_option *option, const char *text, char *message, size_t size) {
    enum { SHOWN = 80 };
    char range[160];
    const bool list = option->kind == APP_SIZES || option->kind == APP_REALS;
    size_t items = 1;
    for (const char *c = text; list && *c != '\0'; c++) items += *c == ',';
    if (items > APP_LIST_MAX) {
        (void)snprintf(message, size, "a list of %zu numbers is too long: at most %d%s%s", items,
                       APP_LIST_MAX, option->longer != NULL ? "; " : "",
                       option->longer != NULL ? option->longer : "");
        return;
    }
    range_text(option, text, range, sizeof range);
    (void)snprintf(message, size, "'%.*s%s' is not %s%s", SHOWN, text, strlen(text) > SHOWN ? "..." : "",
                   list ? "a list, separated by commas, of: " : "", range);
}

bool app_store(const app_option *option, const char *text, void *values, char *message, size_t size) {
    void *target = (char *)values + option->offset;
    bool fits = true;
    switch (option->kind) {
    case APP_FLAG:
        *(bool *)target = true;
        return true;
    case APP_TEXT:
        if (text[0] == '\0') (void)snprintf(message, size, "the value is empty");
        *(const char **)target = text;
        return text[0] != '\0';
    case APP_CHOICE:
        for (int i = 0; option->choices[i] != NULL; i++)
            if (strcmp(option->choices[i], text) == 0) {
                *(int *)target = i;
                return true;
            }
        refuse_choice(option, text, message, size);
        return false;
    case APP_SIZE:
    case APP_REAL:
        fits = store_number(option, text, target);
        break;
    case APP_SIZES:
    case APP_REALS:
        fits = store_list(option, text, target);
        break;
    }
    if (!fits) refuse_number(option, text, message, size);
    return fits;
}

static void store(const struct argp_state *state, const app_option *option, const char *text, void *values) {
    char message[1024];
    if (!app_store(option, text, values, message, sizeof message))
        argp_error(state, "--%s: %s", option->name, message);
}

/* ---- argp from tables ---- */

static size_t table_length(const app_option *table) {
    size_t n = 0;
    while (table != NULL && table[n].name != NULL) n++;
    return n;
}

static struct argp_option *argp_table(const app_option *own) {
    const size_t n = table_length(own), common = table_length(common_options);
    struct argp_option *out = app_alloc(n + common + 2, sizeof *out);
    for (size_t i = 0; i < n; i++)
        out[i] = (struct argp_option){own[i].name, KEY_COMMAND + (int)i, own[i].value, 0, own[i].help, 1};
    out[n] = (struct argp_option){NULL, 0, NULL, 0, "Common options:", 2};
    for (size_t i = 0; i < common; i++)
        out[n + 1 + i] = (struct argp_option){common_options[i].name,  KEY_COMMON + (int)i,
                                              common_options[i].value, 0,
                                              common_options[i].help,  2};
    return out;
}

static error_t parse_option(int key, char *text, struct argp_state *state, app *self) {
    if (key >= KEY_COMMAND && key < KEY_COMMAND + (int)APP_COUNT(self->given)) {
        store(state, &self->command->options[key - KEY_COMMAND], text, self->command->values);
        self->given[key - KEY_COMMAND] = true;
        return 0;
    }
    if (key >= KEY_COMMON && key < KEY_COMMAND) {
        store(state, &common_options[key - KEY_COMMON], text, self);
        if (strcmp(common_options[key - KEY_COMMON].name, "seed") == 0) self->seed_given = true;
        return 0;
    }
    return ARGP_ERR_UNKNOWN;
}

static error_t parse_command(int key, char *text, struct argp_state *state) {
    app *self = state->input;
    const app_command *command = self->command;
    switch (key) {
    case ARGP_KEY_ARG:
        if (self->argument_count >= command->arguments_max)
            argp_error(state, "'%s' is one argument too many; expected: %s", text,
                       command->arguments != NULL ? command->arguments : "none");
        self->arguments[self->argument_count++] = text;
        return 0;
    case ARGP_KEY_END:
        if (self->argument_count < command->arguments_min)
            argp_error(state, "missing argument; expected: %s", command->arguments);
        return 0;
    default:
        return parse_option(key, text, state, self);
    }
}

static void run_parser(app *self, int argc, char **argv) {
    struct argp_option *options = argp_table(self->command->options);
    char *doc = app_format("%s%s%s", self->command->summary, self->command->details != NULL ? "\v" : "",
                           self->command->details != NULL ? self->command->details : "");
    const struct argp argp = {options, parse_command, self->command->arguments, doc, NULL, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, self);
    free(doc);
    free(options);
}

typedef struct dispatch {
    app *self;
    const app_command *commands;
} dispatch;

static char *command_names(const app_command *commands) {
    char *names = app_format("%s", "");
    for (const app_command *c = commands; c->run != NULL; c++) {
        char *longer = app_format("%s%s%s", names, c == commands ? "" : ", ", c->name);
        free(names);
        names = longer;
    }
    return names;
}

/* The first word that is no option chooses the command, which parses the rest. */
static error_t parse_top(int key, char *text, struct argp_state *state) {
    dispatch *d = state->input;
    if (key == ARGP_KEY_NO_ARGS) {
        char *names = command_names(d->commands);
        argp_error(state, "which command? There are: %s", names);
        free(names);
    }
    if (key != ARGP_KEY_ARG) return parse_option(key, text, state, d->self);
    for (const app_command *c = d->commands; c->run != NULL; c++) {
        if (strcmp(c->name, text) != 0) continue;
        d->self->command = c;
        (void)snprintf(d->self->title, sizeof d->self->title, "%s %s", d->self->program, c->name);
        const int first = state->next - 1;
        char *word = state->argv[first];
        state->argv[first] = d->self->title;
        run_parser(d->self, state->argc - first, state->argv + first);
        state->argv[first] = word;
        state->next = state->argc;
        return 0;
    }
    char *names = command_names(d->commands);
    argp_error(state, "'%s' is no command; there are: %s", text, names);
    free(names);
    return ARGP_ERR_UNKNOWN;
}

static void parse_with_commands(app *self, int argc, char **argv, const char *summary,
                                const app_command *commands) {
    size_t widest = 0;
    for (const app_command *c = commands; c->run != NULL; c++)
        if (strlen(c->name) > widest) widest = strlen(c->name);
    char *doc = app_format("%s\vCommands:\n", summary);
    for (const app_command *c = commands; c->run != NULL; c++) {
        char *longer = app_format("%s  %-*s  %s\n", doc, (int)widest, c->name, c->summary);
        free(doc);
        doc = longer;
    }
    char *whole = app_format("%s\n%s COMMAND --help says more.", doc, self->program);
    struct argp_option *options = argp_table(NULL);
    const struct argp argp = {options, parse_top, "COMMAND ...", whole, NULL, NULL, NULL};
    dispatch d = {self, commands};
    (void)argp_parse(&argp, argc, argv, ARGP_IN_ORDER, NULL, &d);
    free(options);
    free(whole);
    free(doc);
}

static void print_version(FILE *stream, struct argp_state *state) {
    (void)state;
    (void)fprintf(stream, "%s (liegrad) %s\n", running->program, lg_version());
}

bool app_given(const app *self, const char *option) {
    for (size_t i = 0; i < table_length(self->command->options); i++)
        if (strcmp(self->command->options[i].name, option) == 0) return self->given[i];
    return false;
}

/* ---- running ---- */

static void on_interrupt(int signal_number) {
    (void)signal_number;
    interrupted = 1;
}

static void install_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_interrupt;
    action.sa_flags = SA_RESTART | (int)SA_RESETHAND;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    action.sa_handler = SIG_IGN;
    action.sa_flags = 0;
    (void)sigaction(SIGXFSZ, &action, NULL);
    (void)sigaction(SIGPIPE, &action, NULL);
}

static void on_log(void *user, lg_log_level level, const char *message) {
    static const char *const names[] = {"debug", "info", "warning", "error"};
    const app *self = user;
    if (level == LG_LOG_DEBUG) return;
    (void)fprintf(stderr, "%s: %s: %s\n", self->title, names[level], message);
}

static char *join(int argc, char **argv) {
    size_t bytes = 1;
    for (int i = 0; i < argc; i++) bytes += strlen(argv[i]) + 1;
    char *text = app_alloc(bytes, 1);
    for (int i = 0, at = 0; i < argc; i++) at += sprintf(text + at, "%s%s", i > 0 ? " " : "", argv[i]);
    return text;
}

static int run_command(app *self) {
    lg_context_options options;
    lg_context_options_init(&options);
    options.log = on_log;
    options.log_user = self;
    options.cancel = &interrupted;
    const lg_status status = lg_context_create(&options, &self->context);
    if (status != LG_OK) return app_fail(self, status, "%s", lg_status_sentence(status));
    int code = self->command->run(self);
    lg_context_destroy(self->context);
    if ((fflush(stdout) != 0 || ferror(stdout)) && code == APP_EXIT_OK)
        code = app_fail(self, LG_FILE, "the results could not be written to standard output");
    return code;
}

int app_main(int argc, char **argv, const char *program, const char *summary, const app_command *commands) {
    const long processors = sysconf(_SC_NPROCESSORS_ONLN);
    app self = {.program = program, .seed = 1, .threads = processors > 0 ? (uint64_t)processors : 1};
    if (self.threads > 256) self.threads = 256;
    running = &self;
    argp_err_exit_status = APP_EXIT_USAGE;
    argp_program_version_hook = print_version;
    (void)snprintf(self.title, sizeof self.title, "%s", program);
    self.command_line = join(argc, argv);
    argv[0] = self.title; /* what getopt's own messages begin with */
    install_signals();
    if (commands[0].name == NULL) {
        self.command = &commands[0];
        run_parser(&self, argc, argv);
    } else {
        parse_with_commands(&self, argc, argv, summary, commands);
    }
    lg_runtime_setup();
    const int code = run_command(&self);
    free(self.command_line);
    running = NULL;
    return code;
}
