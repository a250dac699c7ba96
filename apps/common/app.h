/* What all executables share: nested commands over GNU argp, option tables, exit codes, signals, JSON,
 * tables, progress, worker threads, text files and plots.
 *
 * Exit codes: 0 success; 1 a check failed; 2 usage; 3 a file; 4 not finite or no convergence; 5 out of
 * memory; 128 + n stopped by signal n with the state saved (130: Ctrl-C). Results go to stdout, everything
 * else to stderr.
 */
#ifndef LG_APPS_APP_H
#define LG_APPS_APP_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "core/count.h"
#include "core/median.h"
#include "core/text.h"
#include "liegrad/context.h"
#include "liegrad/fields.h"
#include "liegrad/ranks.h"
#include "liegrad/status.h"

enum {
    APP_EXIT_OK = 0,
    APP_EXIT_CHECK = 1,
    APP_EXIT_USAGE = 2,
    APP_EXIT_FILE = 3,
    APP_EXIT_NUMERIC = 4,
    APP_EXIT_MEMORY = 5,
    APP_EXIT_INTERRUPTED = 130 /* app_main makes it 128 + the signal */
};

/* ---- options as data ---- */

typedef struct app app;
/* The first 64 sentences of app_warn. */
typedef struct app_warnings app_warnings;

/* Options: a table of rows (liegrad/fields.h) and the structure that has their values. Before the command
 * line is read a structure of `size` bytes becomes zero (0: it stays as it is) and gets the rows' defaults.
 */
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

/* What a command does with the processes that mpirun starts. */
typedef enum app_together {
    APP_ALONE,  /* refuses more than one */
    APP_RANKS,  /* they compute one result: app->ranks */
    APP_WORKERS /* they take pieces of work from a queue (common/board.h) */
} app_together;

typedef struct app_command {
    const char *name; /* NULL in a program without commands; the table ends with run == NULL */
    /* "DATA.h5", for the usage line, which also says how many there may be: "A [B]" one or two, "A B..." two
     * or more, "A | B C ..." one or more. NULL: none. */
    const char *arguments;
    const char *summary;          /* one line */
    const char *details;          /* after the options in --help; may be NULL */
    const app_settings *settings; /* the options; ends with rows == NULL; may be NULL */
    /* Returns the exit code. Files that options name (lg_field.file) are checked before. */
    int (*run)(app *app);
    app_together together;
} app_command;

/* An option of the command at hand. */
typedef struct app_slot {
    char name[32];
    const lg_field *row;
    void *values;
    bool given; /* on the command line */
} app_slot;
enum { APP_SLOTS = 96 };

enum { APP_ARGUMENTS = 4096 };
struct app {
    const char *program;
    const app_command *command;
    char title[64];     /* "lg-hamiltonian train", begins every message */
    char *command_line; /* as a shell takes it, for what we write into files */
    bool json;
    uint64_t seed, threads;
    bool seed_given;
    int argument_count;
    const char *arguments[APP_ARGUMENTS];
    app_slot slots[APP_SLOTS];
    size_t slot_count;
    lg_context *context;
    app_warnings *warnings;
    uint32_t rank, rank_count; /* as mpirun says: 0 of 1 without it */
    const lg_ranks *ranks;     /* of an APP_RANKS command under mpirun; otherwise NULL */
    bool shares;               /* the outputs with the processes of a board: none claims them */
};

app_warnings *app_warnings_create(void);
void app_warnings_destroy(app_warnings *warnings);
/* Parses, runs, flushes stdout; what main returns. */
int app_main(int argc, char **argv, const char *program, const char *summary, const app_command *commands);
/* Whether the option was on the command line. */
bool app_given(const app *app, const char *option);
/* Nothing is given, and the command's settings have their defaults. */
void app_choose_command(app *app, const app_command *command);
/* The option of that name; NULL when the command has none. */
app_slot *app_find_slot(const app *app, const char *option);
/* `text` becomes the option's value, as from the command line (a text is borrowed), and the option is given.
 * LG_INVALID_ARGUMENT: nothing is stored, and the sentence says why. */
lg_status app_store(app_slot *slot, const char *text, lg_error *error);
lg_status app_store_number(app_slot *slot, double value, lg_error *error); /* of a number or a list of one */
/* What was not given becomes that of `from`, a structure like settings->values. `preset`: only where the rows
 * have no default of their own. */
void app_adopt(app *app, const app_settings *settings, const void *from, bool preset);
/* True after the first SIGINT (Ctrl-C), SIGTERM or SIGHUP; the second one of a kind kills. */
bool app_interrupted(void);
/* "Ctrl-C", "SIGTERM" or "SIGHUP": what stopped this command. */
const char *app_stopper(void);
/* From now on SIGHUP asks for new log files instead of the end, under nohup too. */
void app_reopen_on_hangup(void);
/* True once after such a signal. */
bool app_reopen_asked(void);

/* ---- ranks (ranks.c) ---- */

/* Before anything else: rank and count from the environment. Ranks other than 0 are silent: they would say
 * what rank 0 says. */
void app_find_ranks(app *app);
/* Default of --threads: this rank's part of the processors. */
uint64_t app_processors(void);
/* Joins the other ranks where the command computes with them; an exit code. */
int app_join_ranks(app *app);
/* No exchange follows: what this rank does now, or fails in, is its own affair. */
void app_end_exchanges(app *app);
/* The last words of a command: a rank that fails while others wait for it ends them all. */
int app_leave_ranks(app *app, int code);

/* ---- failing ---- */

int app_exit_code(lg_status status);
/* The command has ended, with this exit code. From any depth, in the main thread. Locks and ranks are left;
 * objects of the stack are not destroyed. */
void app_end(int code) __attribute__((noreturn));
/* A sentence on stderr, and the end with the status' exit code. */
void app_stop(const app *app, lg_status status, const char *format, ...)
    __attribute__((noreturn, format(printf, 3, 4)));
/* A sentence about the command line with a hint at --help, and the end with APP_EXIT_USAGE. */
void app_stop_usage(const app *app, const char *format, ...) __attribute__((noreturn, format(printf, 2, 3)));
const char *app_sentence(lg_status status, const lg_error *error); /* of `error`, or the status' own */
/* Nothing after LG_OK; otherwise the sentence of `error`, or the status' own, and the end. LG_CANCELLED after
 * a signal: "stopped by Ctrl-C", or by the other signal. */
void app_must(const app *app, lg_status status, const lg_error *error);
/* The same for what went wrong with the file `path`: exit code 3 whatever the status, except for memory and
 * Ctrl-C. */
void app_must_file(const app *app, lg_status status, const lg_error *error, const char *path);
/* A call of the library that has `&error` as an argument, and must succeed. */
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
/* A local variable that is freed, or destroyed, where its scope ends:
 *   APP_FREE double *theta = app_alloc(n, sizeof *theta);
 *   APP_CLEAN(lg_trajectories_destroy) lg_trajectories test = {0}; */
#define APP_FREE           __attribute__((cleanup(app_free)))
#define APP_CLEAN(destroy) __attribute__((cleanup(destroy)))
void app_free(void *pointer); /* the pointer at this address is freed */
/* A sentence on stderr; returns the status' exit code. */
int app_fail(const app *app, lg_status status, const char *format, ...) __attribute__((format(printf, 3, 4)));
const char *app_last_failure(void); /* the last such sentence */
/* The same for what went wrong while reading or writing `path`: exit code 3 whatever the status, except for
 * memory and Ctrl-C. `error` may be NULL. */
int app_fail_file(const app *app, lg_status status, const lg_error *error, const char *path);
/* Fills `error` (may be NULL) and returns `status`: what a function gives back to the one that will tell. */
lg_status app_error(lg_error *error, lg_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* A sentence on stderr, kept for app_json_warnings; a sentence that was kept before is not told again. From
 * any thread; the library's come here too. */
void app_warn(const app *app, const char *format, ...) __attribute__((format(printf, 2, 3)));
struct lg_scene;
/* The start of a scene without `initial` is drawn with --seed, and a warning says so. */
void app_scene_start(const app *app, struct lg_scene *scene, const char *path);
/* A sentence about the command line with a hint at --help; returns APP_EXIT_USAGE. */
int app_usage(const app *app, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* A sentence with the program's name; exits with code 5. */
void app_out_of_memory(void) __attribute__((noreturn));
/* Zeroed, aligned to 64 bytes; exits with code 5 when there is none. Freed with free. */
void *app_alloc(size_t count, size_t size);
/* An empty text that never has `failed`: it ends the program as app_alloc does. Every text of an executable
 * begins so. Not thread safe. */
lg_text app_text(void);
/* Returns the status, but ends the program as app_alloc does when memory was missing: for what may be absent
 * and is left out then. */
lg_status app_had_memory(lg_status status);
/* As app_alloc, but NULL when memory ends: for sizes that the user chooses in a run that can go on. */
void *app_try_alloc(size_t count, size_t size);
/* A word of a command line, in quotes where a shell needs them. Freed with free. */
char *app_quote(const char *word);
/* printf into memory, with the same law. */
char *app_format(const char *format, ...) __attribute__((format(printf, 1, 2)));
char *app_format_list(const char *format, va_list arguments) __attribute__((format(printf, 1, 0)));

/* ---- numbers ---- */

/* Whole and finite, no blanks before or behind, decimal. False: *out is untouched. */
bool app_parse_real(const char *text, double *out);
bool app_parse_size(const char *text, uint64_t *out);

double app_seconds(void); /* monotonic clock */
double app_age(void);     /* seconds since the program began */

/* ---- JSON: one object in memory, printed when complete ---- */

typedef struct app_json {
    FILE *stream;
    char *text;
    size_t length;
    bool comma;
    bool people;           /* text for people is made, no JSON */
    struct app_rows *rows; /* of people, between app_result_rows or app_result_named and the end */
    bool named;            /* the rows began with app_result_named */
} app_json;
void app_json_begin(app_json *json);
void app_print_real(FILE *stream, double value); /* the shortest text that reads back the same, or null */
void app_json_real(app_json *json, const char *key, double value); /* null when not finite */
void app_json_size(app_json *json, const char *key, uint64_t value);
void app_json_bool(app_json *json, const char *key, bool value);
void app_json_text(app_json *json, const char *key, const char *value); /* NULL: null */
void app_json_reals(app_json *json, const char *key, const double *values, size_t count);
/* The field of `values` under its name, or under the name of its option where the row says one. */
void app_json_field(app_json *json, const lg_field *row, const void *values);
/* "warnings": the sentences so far, none: an empty array. Before a parallel part or after it. */
void app_json_warnings(app_json *json, const app *app);
void app_json_open(app_json *json, const char *key, char bracket); /* '{' or '[' ; key NULL inside an array */
void app_json_close(app_json *json, char bracket);                 /* '}' or ']' */
/* Closes the object and prints it on stdout. */
void app_json_end(app_json *json);
/* ---- the result of a command: one list, printed as JSON or for people ---- */

/* With --json what follows makes one JSON object. Otherwise each app_result_... prints a line "key  value
 * label" (label NULL: none), each app_result_rows a table, and app_json_... nothing. app_json_end ends
 * both. */
void app_result_begin(app_json *json, const app *app);
void app_result_real(app_json *json, const char *key, double value, const char *label);
void app_result_size(app_json *json, const char *key, uint64_t value, const char *label);
void app_result_text(app_json *json, const char *key, const char *value, const char *label);
void app_result_reals(app_json *json, const char *key, const double *values, size_t count, const char *label);
/* For people alone. */
void app_result_line(app_json *json, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Opens an array of objects, which app_json_open(json, NULL, '{') begins; every object has the same members,
 * and the names of those that are no arrays are the heads of the table. */
void app_result_rows(app_json *json, const char *key);
/* The same for an object of objects, which app_json_open(json, NAME, '{') begins: the names are the first
 * column, and `names` is its head. */
void app_result_named(app_json *json, const char *key, const char *names);
void app_result_rows_end(app_json *json);

/* Text as a JSON string with its quotes: escapes, and \ufffd for what is not UTF-8. */
void app_json_quote(FILE *stream, const char *text);

/* ---- tables for people ---- */

typedef struct app_table {
    size_t columns, cells, room;
    char **text;
} app_table;
void app_table_begin(app_table *table, size_t columns);
void app_table_cell(app_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* A row: the tabs of the text part its cells. The first row of a table {0} tells the number of columns. */
void app_table_row(app_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* Prints with aligned columns (the first to the left), a line under the first row, and frees. */
void app_table_end(app_table *table, FILE *stream);

/* ---- progress on stderr, only when it is a terminal ---- */

typedef struct app_progress {
    bool active;
    double start, shown;
    uint64_t first, total;
} app_progress;
/* `first` units were done before (a resumed run): they do not count for the remaining time. */
void app_progress_begin(app_progress *progress, uint64_t first, uint64_t total);
void app_progress_show(app_progress *progress, uint64_t done, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
void app_progress_end(app_progress *progress);

/* ---- threads ---- */

/* task(user, i) for i in 0..count-1, each once, on up to `threads` threads. A task writes to its own memory
 * only. */
void app_parallel(uint64_t threads, size_t count, void (*task)(void *user, size_t index), void *user);

/* ---- files ---- */

/* A regular file to be read, or NULL. Never waits, as opening a pipe that nobody writes to would. */
FILE *app_open(const char *path);
/* A text file in memory that replaces `path` when it is complete: temporary name beside it, fsync, rename. */
typedef struct app_file {
    const char *path;
    FILE *stream;
    char *text;
    size_t length;
} app_file;
void app_file_begin(app_file *file, const char *path);
/* On failure the old file stands and `error` says why. */
lg_status app_file_end(app_file *file, lg_error *error);
void app_file_discard(app_file *file);
/* Fails now rather than after an hour of work: the folder of `path` must exist and be writable, `path` a
 * regular file or nothing. */
lg_status app_check_writable(const char *path, lg_error *error);
/* Whether both paths lead to one file, through links or other spellings too. */
bool app_same_file(const char *a, const char *b);

typedef struct app_path {
    const char *option; /* without the dashes; NULL: an argument, which app->arguments does not hold */
    const char *path;   /* NULL: not given */
    lg_file_use use;
} app_path;
/* Before anything long: each output can be written, none of them is an input (the command's arguments and
 * what is LG_FILE_READ) or another output, pictures have a picture's ending. Otherwise tells why; an exit
 * code. The options of a command whose rows say `file` are checked without being asked for. */
int app_check_outputs(const app *app, const app_path *paths, size_t count);
/* This process alone writes the file or folder until it ends (lg_lock_take); app_check_outputs claims the
 * outputs. Once more is nothing new; pipes and devices are nobody's, and of ranks the first one claims.
 * LG_FILE: another process is at it, which `error` names. */
lg_status app_claim(const app *app, const char *path, lg_error *error);
/* Creates the folder if there is none (one level). */
lg_status app_make_folder(const char *path, lg_error *error);

/* ---- plots through gnuplot ---- */

/* FILE.svg or FILE.png; data go to FILE.dat and the script to FILE.gp beside it. Blocks of data are separated
 * by app_plot_block and addressed as `index k` of `datafile` in the script. */
typedef struct app_plot {
    char *picture;
    app_file data, script;
    char *data_path, *script_path;
} app_plot;
bool app_plot_name_fits(const char *picture);
/* Width and height in pixels. The name fits: LG_FILE_DRAWN has looked. */
void app_plot_begin(app_plot *plot, const char *picture, int width, int height);
void app_plot_block(app_plot *plot);
/* Writes both files and runs gnuplot. Without gnuplot they are left, and a warning says so: LG_OK. When a
 * file cannot be written none of the three is left by this call. */
lg_status app_plot_end(const app *app, app_plot *plot, lg_error *error);

#endif
