/* What all executables share: nested commands over GNU argp, option tables, exit codes, signals, JSON,
 * tables, progress, worker threads, text files and plots.
 *
 * Exit codes: 0 success; 1 a check failed; 2 wrong usage; 3 a file cannot be read or written; 4 a number is
 * not finite or a method did not converge; 5 out of memory; 128 + n stopped by signal n after the state was
 * saved (130: Ctrl-C). Results go to stdout, everything else to stderr. */
#ifndef LG_APPS_APP_H
#define LG_APPS_APP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "core/count.h"
#include "core/median.h"
#include "core/text.h"
#include "liegrad/core.h"
#include "liegrad/files.h"
#include "liegrad/settings.h"
#include "settings/result.h"

enum {
    APP_EXIT_OK = 0,
    APP_EXIT_CHECK = 1,
    APP_EXIT_USAGE = 2,
    APP_EXIT_FILE = 3,
    APP_EXIT_NUMERIC = 4,
    APP_EXIT_MEMORY = 5,
    APP_EXIT_INTERRUPTED = 130 /* app_main replaces it by 128 + the signal's number */
};

/* ---- tables of options ---- */

typedef struct app app;

/* Options: a table of rows (liegrad/settings.h) and the structure that holds their values. Before the command
 * line is read, a structure of `size` bytes is set to zero (size 0: it is not zeroed) and then gets the
 * defaults of the rows. */
typedef struct app_settings {
    const lg_field *rows;
    void *values;
    size_t size;
} app_settings;
#define APP_GIVEN(rows, values)                                                                              \
    { rows, &(values), 0 }
#define APP_SETTINGS_END                                                                                     \
    { NULL, NULL, 0 }
#define APP_SETTINGS(...) ((const app_settings[]){__VA_ARGS__, APP_SETTINGS_END})

/* Rows of options that several commands have, in the structures with their values. */
#define APP_OUT(type, unit_, ...) LG_OPTION(type, out, STRING, unit_, __VA_ARGS__)
#define APP_SECONDS(type, ...)    LG_OPTION(type, seconds, REAL, "S", __VA_ARGS__, .high = 1e9)
#define APP_BOUND(type, ...)      APP_SECONDS(type, __VA_ARGS__, .above = true) /* --seconds, not 0 */
#define APP_RESUME(type, ...)     LG_OPTION(type, resume, STRING, "FILE", __VA_ARGS__)
#define APP_STOP_AFTER(type, ...) LG_OPTION(type, stop_after, U64, "n", __VA_ARGS__, .low = 1, .high = 1e9)
#define APP_RUNS(type, ...)       LG_OPTION(type, runs, U64, "n", __VA_ARGS__, .low = 1)
#define APP_PART(type, ...)       LG_OPTION(type, part, NAME, NULL, __VA_ARGS__)
#define APP_DTYPE(type, ...)      LG_OPTION(type, dtype, NAME, NULL, __VA_ARGS__)
#define APP_SCHEME(type, ...)     LG_OPTION(type, scheme, STRING, __VA_ARGS__)
#define APP_T_END(type, ...)      LG_OPTION(type, t_end, REAL, "T", __VA_ARGS__, LG_POSITIVE)
#define APP_POINTS(type, ...)     LG_OPTION(type, points, U64, "M", __VA_ARGS__, .low = 2, .high = 1e8)
#define APP_TOLERANCE(type, ...)  LG_OPTION(type, tolerance, REAL, "TOL", __VA_ARGS__, .low = 1e-15)

/* The values of a command that has no options but these. */
typedef struct app_common {
    const char *out;
    uint64_t epochs;
    double t_end, seconds;
} app_common;
extern app_common app_common_given;

/* What a command does when mpirun starts several processes of it. */
typedef enum app_together {
    APP_ALONE, /* the command does not run */
    APP_RANKS  /* the processes compute one result together: app->ranks */
} app_together;

typedef struct app_command {
    const char *name; /* NULL in a program without commands; a row with run == NULL ends the table */
    /* The arguments as the usage line shows them, e.g. "DATA.h5". This text also sets how many are allowed:
     * "A [B]" means one or two, "A B..." two or more, "A | B C ..." one or more. NULL means that there are
     * none. */
    const char *arguments;
    const char *summary; /* one line */
    const char *details; /* --help prints them after the options; may be NULL */
    /* tables of options; an entry with rows == NULL ends the list; may be NULL */
    const app_settings *settings;
    /* Sets app->code if it is not 0. Before it is called, the files that options name (lg_field.file) are
     * checked. */
    void (*run)(app *app);
    app_together together;
    const void *row;                   /* for a `run` that several commands share */
    const struct app_plot_kind *plots; /* the options --plot and --plot-kind follow from it; may be NULL */
} app_command;

/* An option of the chosen command. */
typedef struct app_slot {
    char name[32];
    const lg_field *row;
    void *values;
    bool given; /* whether it was on the command line */
} app_slot;
enum { APP_SLOTS = 96 };

enum { APP_ARGUMENTS = 4096 };
struct app {
    const char *program;
    const app_command *command;
    char title[64];     /* for example "lg-hamiltonian train"; every message begins with it */
    char *command_line; /* quoted for a shell; it is recorded in the files that the program writes */
    bool json, help_all;
    uint64_t seed, threads;
    bool seed_given;
    int argument_count;
    const char *arguments[APP_ARGUMENTS];
    app_slot slots[APP_SLOTS];
    size_t slot_count;
    lg_context *context;
    struct app_json *out;      /* the result of the command; app_main prints it */
    int code;                  /* the exit code, set by the command */
    uint32_t rank, rank_count; /* from mpirun's environment; 0 and 1 without mpirun */
    const lg_ranks *ranks;     /* set for an APP_RANKS command under mpirun; otherwise NULL */
    bool continues; /* The command continues an earlier run: it does not say that it replaces its results. */
};

/* The function that apps/main.c calls when the executable is started under the name of a program. */
#define APP_PROGRAM(name)                                                                                    \
    int name##_main(int argc, char **argv);                                                                  \
    int name##_main(int argc, char **argv)
/* Parses the command line, runs the command and flushes stdout. Returns the exit code, which main returns. */
int app_main(int argc, char **argv, const char *program, const char *summary, const app_command *commands);
/* The program's app: from the parsing of the command line to the end of app_main. */
const app *app_running(void);
/* Returns whether the option was on the command line. */
bool app_given(const app *app, const char *option);
/* Sets the command and gives its settings their defaults. No option counts as given. Its plots have no
 * options: they are those of the command line. */
void app_choose_command(app *app, const app_command *command);
/* `old` is an earlier name of the option `now`, in commands whose title (app->title) begins with `command`. A
 * command that has an option named `old` keeps it; a command without the option `now` rejects `old`. */
typedef struct app_alias {
    const char *command, *old, *now;
    const char *value; /* The old spelling is a switch for --now=value; NULL: it takes the value of --now. */
} app_alias;
extern const app_alias app_aliases[]; /* aliases.c; a last row of NULL */
/* Returns the option that has this name now or had it earlier; NULL: the command has no such option. */
app_slot *app_find_slot(const app *app, const char *option);
/* Sets the option's value from `text`, as the command line does, and marks the option as given. A string
 * value points to `text`, which must live on. LG_INVALID_ARGUMENT: nothing is stored, and `error` says
 * why. */
lg_status app_store(app_slot *slot, const char *text, lg_error *error);
/* Returns true after the first SIGINT (Ctrl-C), SIGTERM or SIGHUP. A second signal of the same kind kills the
 * process. */
bool app_interrupted(void);
/* The name of the signal that stopped this command: "Ctrl-C", "SIGTERM" or "SIGHUP". */
const char *app_stopper(void);
/* From now on SIGHUP asks for new log files instead of ending the program, also under nohup. */
void app_reopen_on_hangup(void);
/* Returns whether SIGHUP has arrived since the last call that returned true. */
bool app_reopen_asked(void);

/* ---- printing (screen.c) ---- */

/* From now on stdout and stderr print each byte that could control a terminal as \x1b, with its value.
 * These are control characters except newline and tab, marks of the direction of writing, and bytes that are
 * not UTF-8. */
void app_screen_begin(void);
/* Flushes stdout; false if something could not be written. */
bool app_screen_flush(void);
/* Writes control sequences of our own to a terminal at standard error. */
void app_screen_raw(const char *text);
/* True for the number of a character that does nothing to a terminal. The others are control characters,
 * marks of direction, ends of lines and paragraphs, and LG_NO_CHARACTER. */
bool app_is_harmless(uint32_t code);
/* printf into new memory, for text that holds names: newlines and tabs of the arguments are shown as \x0a and
 * \x09, so that no name can forge a line or a cell. Everything that people read is made by it, or by a table.
 * Each function X_words takes such a text and frees it; the macro X takes a format and its arguments. */
char *app_words(const char *format, ...) __attribute__((format(printf, 1, 2)));
void app_put_words(FILE *to, char *words);
#define app_put(to, ...) app_put_words(to, app_words(__VA_ARGS__))
/* Prints "PROGRAM COMMAND: " and a sentence on stderr. */
void app_note_words(const app *app, char *words);
#define app_note(app, ...) app_note_words(app, app_words(__VA_ARGS__))
char *app_shown(const char *text); /* A text without any such characters, freed with free. */

/* ---- ranks (ranks.c) ---- */

/* Called before anything else: takes rank and rank count from the environment. Ranks other than 0 print
 * nothing on stdout and stderr, because they would repeat what rank 0 prints. */
void app_find_ranks(app *app);
/* Prints a sentence on the standard error. Ranks other than 0 print it, too. */
void app_say_as_rank(const app *app, const char *sentence);
/* Default of --threads: this rank's share of the processors. */
uint64_t app_processors(void);
/* Connects to the other ranks if the command computes with them (APP_RANKS). */
void app_join_ranks(app *app);
/* Says that the ranks exchange nothing from here on: a rank that fails later does not end the others. */
void app_end_exchanges(app *app);
/* Called at the end of a command. A rank that fails while other ranks may still wait for it ends all ranks.
 * Returns `code`. */
int app_leave_ranks(app *app, int code);

/* ---- errors ---- */

/* Ends the command with this exit code. May be called at any depth, in the main thread only. Locks are
 * released and the ranks are left; objects on the stack are not destroyed. */
void app_end(int code) __attribute__((noreturn));
/* Prints a sentence on stderr and returns the exit code of `status`. */
int app_fail_words(const app *app, lg_status status, char *words);
#define app_fail(app, status, ...) app_fail_words(app, status, app_words(__VA_ARGS__))
/* Prints a sentence about the command line and a hint at --help; returns APP_EXIT_USAGE. */
int app_usage_words(const app *app, char *words);
#define app_usage(app, ...) app_usage_words(app, app_words(__VA_ARGS__))
/* The same, as the end of the command. */
#define app_stop(...)       app_end(app_fail(__VA_ARGS__))
#define app_stop_usage(...) app_end(app_usage(__VA_ARGS__))
/* The message of `error`; if there is none, the standard sentence of `status`. */
const char *app_sentence(lg_status status, const lg_error *error);
/* Does nothing for LG_OK. Otherwise prints app_sentence(status, error) and ends the command. For LG_CANCELLED
 * after a signal it prints "stopped by Ctrl-C", or the name of the other signal. */
void app_must(const app *app, lg_status status, const lg_error *error);
/* As app_must, for an error with the file `path`. The exit code is 3 whatever the status, except when memory
 * is missing or Ctrl-C stopped the command. */
void app_must_file(const app *app, lg_status status, const lg_error *error, const char *path);
/* Calls a function of the library that takes `&error` as an argument; a failure ends the command. */
#define APP_MUST(app, call)                                                                                  \
    do {                                                                                                     \
        lg_error error = {LG_OK, ""};                                                                        \
        app_must(app, call, &error);                                                                         \
    } while (0)
#define APP_MUST_FILE(app, path, call)                                                                       \
    do {                                                                                                     \
        lg_error error = {LG_OK, ""};                                                                        \
        app_must_file(app, call, &error, path);                                                              \
    } while (0)
/* APP_MUST of function(context, ..., &error), and APP_MUST_FILE of function(context, path, ..., &error). */
#define APP_DO(app, function, ...) APP_MUST(app, function((app)->context, __VA_ARGS__, &error))
#define APP_FILE(app, path, function, ...)                                                                   \
    APP_MUST_FILE(app, path, function((app)->context, path, __VA_ARGS__, &error))
/* A local variable that is freed, or destroyed, at the end of its scope:
 *   APP_FREE double *theta = app_alloc(n, sizeof *theta);
 *   APP_CLEAN(lg_trajectories_destroy) lg_trajectories test = {0}; */
#define APP_FREE           __attribute__((cleanup(app_free)))
#define APP_CLEAN(destroy) __attribute__((cleanup(destroy)))
void app_free(void *pointer);       /* `pointer` is the address of the pointer to be freed */
const char *app_last_failure(void); /* the last sentence that app_fail or app_usage printed */
/* As app_fail, for an error while reading or writing `path`. The exit code is 3 whatever the status, except
 * when memory is missing or Ctrl-C stopped the command. `error` may be NULL. */
int app_fail_file(const app *app, lg_status status, const lg_error *error, const char *path);
/* Prints a warning on stderr and keeps it for the result, which has the first 64. A warning that is
 * already kept is not printed again. May be called from any thread; warnings of the library come here too. */
void app_warn_words(const app *app, char *sentence);
#define app_warn(app, ...) app_warn_words(app, app_format(__VA_ARGS__))
struct lg_scene;
/* If the scene has no `initial`, draws its start with --seed and warns that it did so. */
void app_scene_start(const app *app, struct lg_scene *scene, const char *path);
/* Prints "out of memory" with the program's name; exits with code 5. */
void app_out_of_memory(void) __attribute__((noreturn));
/* Returns zeroed memory, aligned to 64 bytes; without memory the program exits with code 5. Freed with
 * free. */
void *app_alloc(uint64_t count, size_t size);
/* As app_alloc, for memory that lives until the command ends and is not freed by anyone. */
void *app_keep(uint64_t count, size_t size);
void app_free_kept(void); /* at the end of app_main */
/* Returns an empty text. When memory is missing it ends the program as app_alloc does, so its `failed` is
 * never set. Every text of an executable begins with this call. Not thread safe. */
lg_text app_text(void);
/* Returns `status`, except that LG_OUT_OF_MEMORY ends the program as app_alloc does. For calls whose other
 * failures mean that an optional part is left out. */
lg_status app_had_memory(lg_status status);
/* As app_alloc, but returns NULL when there is no memory. For sizes that the user chooses, where the run can
 * go on without the memory. */
void *app_try_alloc(uint64_t count, size_t size);
/* A word of a command line, quoted where a shell needs it. Freed with free. */
char *app_quote(const char *word);
/* printf into new memory, freed with free. */
char *app_format(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* ---- numbers ---- */

double app_seconds(void); /* monotonic clock */

/* ---- the result of a command: one list of calls prints JSON or text for people ---- */

typedef struct app_table {
    size_t columns, cells, room;
    char **text; /* (cells): first the headings */
} app_table;
typedef struct app_json {
    FILE *stream;
    char *text;
    size_t length;
    bool comma;
    bool people;        /* the output is text for people, not JSON */
    const char *prefix; /* of the lines for people; "" at the beginning */
    /* The open table for people, between app_result_table and app_result_rows_end: the keys of its first
     * object are the headings, the members of all objects are the cells. */
    bool tabled;
    const char *names; /* heading of the column of object names; NULL if the objects have no names */
    app_table table;
} app_json;

/* The result is app->out. With --json the following calls build one JSON object, which is printed when it is
 * complete. Otherwise each app_result_... prints one line with key, value and label (label may be NULL), each
 * app_result_rows prints a table, and app_json_... prints nothing by itself. A number reads back as the same
 * double; one that is not finite, and a text that is NULL, are null. */
void app_result_begin(app_json *json, const app *app); /* called by app_main, before the command */
/* Prints what the command has put into its result; JSON with the array "warnings". Called by app_main after
 * the command, or before, if something may fail after the result or is printed after it. */
void app_result_end(const app *app);
void app_json_put(app_json *json, lg_result value);
#define app_json_real(json, key, value)          app_json_put(json, LG_AS_REAL(key, value))
#define app_json_size(json, key, value)          app_json_put(json, LG_AS_WHOLE(key, value))
#define app_json_text(json, key, value)          app_json_put(json, LG_AS_TEXT(key, value))
#define app_json_reals(json, key, values, count) app_json_put(json, LG_AS_REALS(key, values, count))
/* Puts entries, each made by these or by LG_AS_REAL and the like; of APP_OBJECT they are the members of an
 * object. */
#define APP_PUT(json, ...)         app_json_list(json, LG_RESULTS(__VA_ARGS__))
#define APP_OBJECT(json, key, ...) app_json_object(json, key, LG_RESULTS(__VA_ARGS__))
void app_json_list(app_json *json, const lg_result *members);
void app_json_object(app_json *json, const char *key, const lg_result *members);
/* Writes the field of `values`. Its key is the row's option name if there is one, otherwise the row's
 * name. */
void app_json_field(app_json *json, const lg_field *row, const void *values);
/* '{' or '['; key is NULL inside an array */
void app_json_open(app_json *json, const char *key, char bracket);
void app_json_close(app_json *json, char bracket); /* '}' or ']' */
#define app_result_real(json, key, value, label) app_json_put(json, LG_REAL(key, value, label))
/* As app_result_real; people see the number only if it is finite. */
void app_result_known(app_json *json, const char *key, double value, const char *label);
/* A line that is printed for people only. */
void app_result_words(app_json *json, char *line);
#define app_result_line(json, ...) app_result_words(json, app_words(__VA_ARGS__))
/* Opens an array of objects, or an object of objects that each have a name. All have the same members. In the
 * table for people each member that is no array is a column, with its key as the heading; the objects' names
 * are the first column, and `names` is its heading. */
void app_result_table(app_json *json, const char *key, char bracket, const char *names);
#define app_result_rows(json, key)         app_result_table(json, key, '[', NULL)
#define app_result_named(json, key, names) app_result_table(json, key, '{', names)
void app_result_rows_end(app_json *json);

/* ---- progress on stderr, only when it is a terminal ---- */

typedef struct app_progress {
    bool active;
    double start, shown;
    uint64_t first, total;
} app_progress;
/* `first` is the number of units that were done before, in a resumed run. They do not count in the estimate
 * of the remaining time. */
void app_progress_begin(app_progress *progress, uint64_t first, uint64_t total);
bool app_progress_due(app_progress *progress, uint64_t done); /* at most ten times a second, and at the end */
void app_progress_words(const app_progress *progress, uint64_t done, char *words);
#define app_progress_show(progress, done, ...)                                                               \
    do {                                                                                                     \
        if (app_progress_due(progress, done)) app_progress_words(progress, done, app_words(__VA_ARGS__));    \
    } while (0)
void app_progress_end(app_progress *progress);

/* ---- threads ---- */

/* Calls task(user, i) once for each i in 0..count-1, on up to `threads` threads. A task must write to its own
 * memory only. */
void app_parallel(uint64_t threads, size_t count, void (*task)(void *user, size_t index), void *user);

/* ---- files ---- */

/* Adds the bytes of a regular file to the hash. Errors: LG_FILE and LG_NOT_FOUND with a sentence. */
lg_status app_hash_file(const char *path, lg_sha256 *state, lg_error *error);
/* A text file that is built in memory and replaces `path` when it is complete: written under a temporary name
 * in the same folder, fsync, rename. */
typedef struct app_file {
    const char *path;
    FILE *stream;
    char *text;
    size_t length;
} app_file;
void app_file_begin(app_file *file, const char *path);
/* On failure the old file is left as it was, and `error` says why. The status is LG_FILE if
 * app_may_replace rejects the file. */
lg_status app_file_end(app_file *file, lg_error *error);
/* Checks early whether `path` can be written, rather than after an hour of work: its folder must exist and be
 * writable, and `path` must be a regular file or not exist. */
lg_status app_check_writable(const char *path, lg_error *error);
/* Returns whether both paths lead to the same file, also through links or by different spellings. */
bool app_same_file(const char *a, const char *b);
const char *app_name_of(const char *path); /* the part behind the last slash */
/* Returns the folder that contains `path`. Slashes at the end of `path` do not count. The caller frees the
 * text. */
char *app_folder_of(const char *path);

typedef struct app_path {
    const char *option; /* without the dashes; NULL for an argument that is not in app->arguments */
    const char *path;   /* NULL: the option is not given */
    lg_file_use use;
    const char *kind; /* of LG_FILE_WRITTEN: the attribute `kind` of the file */
} app_path;
/* Writes to `paths` (room for APP_SLOTS) the options that were given and whose rows set `file`. Returns their
 * number. */
size_t app_file_options(const app *app, app_path *paths);
/* Checks the options whose rows set `file`, and up to APP_MORE_PATHS other paths. Each output must be
 * writable and must differ from all inputs (the command's arguments and the paths with LG_FILE_READ) and from
 * all other outputs; a plot must end in .svg or .png. Then claims the outputs (app_claim), and checks that
 * they replace no foreign file (app_may_replace). On failure it says why and ends the command. The options
 * alone are checked for every command; a command with other paths calls it before any long work. */
enum { APP_MORE_PATHS = 8 };
void app_check_outputs(const app *app, const app_path *more, size_t count);
/* Returns whether a regular file begins with the first `lines` lines of `data` (0: whether it equals the
 * data). */
bool app_begins(const char *path, const char *data, size_t bytes, int lines);
/* `replace` of the context (liegrad/core.h), for everything that a command writes; `user` is the app. A file
 * that exists is replaced only if it is an earlier result of the same kind, and a sentence on stderr says so.
 * Such results are: a file in HDF5 that a command wrote; a table with the same header whose rows have as many
 * cells and numbers in the same form; another text with the same first line (of PNG this is its signature).
 * Every other file stays, and the status is LG_FILE. A file that this process has written, and an empty one,
 * may always be replaced. */
lg_status app_may_replace(void *user, const char *path, const void *data, size_t bytes, lg_error *error);
/* Checks before the work that a text with this first line may be written to `path` (NULL: nothing is
 * checked). If the line is the header of a table, the file must be a table of numbers. Ends the command
 * otherwise. app_check_outputs checks files in HDF5, plots, and the data and scripts of plots. */
void app_check_text(const app *app, const char *path, const char *text);
/* Registers an input that app_check_outputs does not see, such as a file that another input names. Ends the
 * command if the file is also an output. app_check_outputs may be called before or after this function. */
void app_reads(const app *app, const char *path);
/* Calls app_reads for every input file that an option names. The value of the option is the user's, or comes
 * from a resumed run. */
void app_read_options(const app *app);
/* Says that the command adds to this file, which it has checked, so it replaces no earlier result. */
void app_continue(const char *path);
/* Writes texts into a folder, except the scripts NAME.sh; the last row is NULL. If a file of such a name
 * holds anything else, the command ends before the first text is written. */
void app_write_texts(const app *app, const char *folder, const lg_named_text *texts);
/* The demo of a program (demo.c): writes the files below apps/PROGRAM/demo into the folder --out, and runs
 * demo.sh there with bash. Its variables are LG_JSON, LG_SEED, LG_THREADS and the options of the command,
 * such as LG_T_END. Returns the exit code of the first command that fails, otherwise 0. */
#define APP_DEMO_EPOCHS(...) LG_OPTION(app_common, epochs, U64, "E", __VA_ARGS__, .low = 1, .high = 1e6)
extern const lg_named_text lg_control_demo[], lg_hamiltonian_demo[], lg_identify_demo[];
#define APP_DEMO(options, texts)                                                                             \
    .name = "demo", .settings = APP_SETTINGS(APP_GIVEN(options, app_common_given)), .run = app_demo,         \
    .row = (texts)
void app_demo(app *app);
/* Prints that an earlier result is replaced. */
void app_say_replaces(const app *app, const char *path);
/* Reserves the file or folder for this process until it ends (lg_lock_take); app_check_outputs calls this for
 * the outputs. Claiming twice does no harm. Pipes and devices are never claimed, and of several ranks only
 * rank 0 claims. LG_FILE: another process has claimed it; `error` says which. */
lg_status app_claim(const app *app, const char *path, lg_error *error);
/* Releases what app_claim reserved. Also happens when the process exits. */
void app_release_claims(void);

/* ---- plots through gnuplot ---- */

/* A plot is the image of --plot, FILE.svg or FILE.png. Its gnuplot script is a fixed text,
 * apps/plots/NAME.gp, of which FILE.gp is a copy. FILE.dat holds the numbers and texts of the plot, so a
 * user's text is never part of a script. Each script starts with apps/plots/begin.gp, which reads FILE.dat.
 * What can be computed from the numbers and texts (ranges, sizes, histograms) is computed in the script. A
 * plot is a row, whose function writes the texts and numbers of what is drawn:
 *
 *   app_plot_text(plot, "%s\t%zu", name, count);               these are T[1] and T[2]
 *   APP_PLOT_COLUMNS(plot, 9, points, {t, 1, 1}, {q, dim, 1}); block 1: t, and the first number of each q
 *   app_plot_block(plot);
 *   APP_PLOT_ROW(plot, 9, t, y);                               this is a line of block 2
 */
extern const lg_named_text app_plot_scripts[]; /* the files apps/plots/NAME.gp, and a last row of NULL */

typedef struct app_plot {
    const char *kind, *script; /* names of the row and its script; the function may set another script */
    app_file texts, data;      /* block 0, which becomes the file; the blocks of numbers */
    bool filled, lined;        /* whether there is a line since the last block; since the last gap */
} app_plot;
bool app_plot_name_fits(const char *image);
/* The text of the first line of each data file, and how each script begins. */
#define APP_PLOT_DATA   "texts and numbers of a plot by liegrad"
#define APP_PLOT_SCRIPT "# This gnuplot script is a fixed text of liegrad."
/* Adds texts, which tabs in the format separate. The script has the first text as T[1], the second as T[2],
 * and as V(1), V(2) if they are numbers. Arguments may hold any bytes: control characters are shown as by
 * app_put. */
void app_plot_words(app_plot *plot, char *words);
#define app_plot_text(plot, ...) app_plot_words(plot, app_words(__VA_ARGS__))
/* Numbers of a plot that lie in memory: the row i has x[i*stride + j], j = 0, ..., count - 1. */
typedef struct app_plot_column {
    const double *x;
    size_t stride, count;
} app_plot_column;
/* Adds lines with the numbers of all columns, in their order, with so many digits; a line of numbers. */
void app_plot_columns(app_plot *plot, int digits, size_t rows, const app_plot_column *columns, size_t count);
#define APP_PLOT_COLUMNS(plot, digits, rows, ...)                                                            \
    app_plot_columns(plot, digits, rows, (const app_plot_column[]){__VA_ARGS__},                             \
                     sizeof(const app_plot_column[]){__VA_ARGS__} / sizeof(app_plot_column))
#define APP_PLOT_ROW(plot, digits, ...)                                                                      \
    APP_PLOT_COLUMNS(                                                                                        \
        plot, digits, 1,                                                                                     \
        {(const double[]){__VA_ARGS__}, 0, sizeof(const double[]){__VA_ARGS__} / sizeof(double)})
/* Interrupts the curve: adds an empty line, but no second one. */
void app_plot_gap(app_plot *plot);
/* Ends a block of data. The script reads the first block as `index 1` of `datafile`. A block without numbers
 * gets a line of NaN, which gnuplot does not draw. */
void app_plot_block(app_plot *plot);

/* A plot that a command can draw. A table of these ends with a row whose name is NULL. `has` below has a bit
 * for each property of what is drawn. */
typedef struct app_plot_kind {
    const char *name, *help; /* name for --plot-kind; what is drawn, as in "the loss over the epochs" */
    const char *script;
    void (*put)(app_plot *plot, const void *of); /* writes the texts and numbers */
    unsigned needs;                              /* the plot exists where `has` has these bits */
    const char *missing;                         /* why it does not exist */
    unsigned usual; /* the default is the first row with `usual` whose bits `has` has, else the first row */
} app_plot_kind;
/* A row; after `put` any designated initialisers may follow. */
#define APP_PLOT(name_, help_, script_, ...)                                                                 \
    { .name = name_, .help = help_, .script = script_, .put = __VA_ARGS__ }
#define APP_PLOTS(...) ((const app_plot_kind[]){__VA_ARGS__, {.name = NULL}})
/* The plot of a command that has one. */
#define APP_DRAWS(help_, script_, put_) .plots = APP_PLOTS(APP_PLOT("plot", help_, script_, put_))
/* The values of --plot and --plot-kind of the command. */
typedef struct app_plot_values {
    const char *plot;   /* NULL: nothing is drawn */
    uint32_t plot_kind; /* 0: the default; otherwise the row's index in the table, plus 1 */
} app_plot_values;
extern app_plot_values app_plot_given;
/* The rows of these options; without --plot-kind where there is one plot. */
const lg_field *app_plot_options(const app_plot_kind *plots);
/* Ends the command if --plot was given and the plot needs bits that `has` lacks. */
void app_plot_check(const app *app, unsigned has);
/* If --plot was given, draws `of`: by the row, or by that of --plot-kind, which it checks. Writes the data
 * and the script, and runs gnuplot; without gnuplot it leaves both and warns. When a file cannot be written,
 * the files that this call wrote are removed, and the command ends. */
void app_plot_row(const app *app, const app_plot_kind *row, const void *of);
void app_plot_draw(const app *app, unsigned has, const void *of);

/* Writes the plot of a confusion matrix (script "confusion"): the count of each entry. confusion (classes,
 * classes): rows are the true classes. */
enum { APP_CLASS_NAME = 64 }; /* LG_SERIES_NAME and LG_TABLE_NAME */
void app_plot_confusion(app_plot *plot, const char *title, const uint64_t *confusion, uint32_t classes,
                        char (*class_name)[APP_CLASS_NAME]);

#endif
