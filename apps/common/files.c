/* Text files that are written completely or not at all, and checks of output files. */
#include "common/app.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "files/csv.h"
#include "files/read_file.h"
#include "files/temporary.h"
#include "liegrad/model.h"

lg_status app_hash_file(const char *path, lg_sha256 *state, lg_error *error) {
    unsigned char block[65536];
    uint64_t bytes;
    FILE *file;
    LG_TRY(lg_read_open(path, &file, &bytes, error));
    for (size_t n; (n = fread(block, 1, sizeof block, file)) > 0;) lg_sha256_add(state, block, n);
    const bool whole = ferror(file) == 0;
    (void)fclose(file);
    return whole ? LG_OK : lg_fail(error, LG_FILE, "%s: cannot be read", path);
}

void app_file_begin(app_file *file, const char *path) {
    *file = (app_file){.path = path};
    file->stream = open_memstream(&file->text, &file->length);
    if (file->stream == NULL) app_out_of_memory();
}

lg_status app_file_end(app_file *file, lg_error *error) {
    const bool whole = fclose(file->stream) == 0;
    const lg_status status =
        whole ? lg_file_write(app_running()->context, file->path, file->text, file->length, error)
              : lg_fail(error, LG_OUT_OF_MEMORY, "%s: out of memory", file->path);
    free(file->text);
    return status;
}

/* realpath; without memory the command ends, because another name of a file would not be found again. */
static char *real_path(const char *path) {
    char *real = realpath(path, NULL);
    if (real == NULL && errno == ENOMEM) app_out_of_memory();
    return real;
}

lg_status app_check_writable(const char *path, lg_error *error) {
    struct stat file, above;
    APP_FREE char *real = real_path(path), *folder = app_folder_of(real != NULL ? real : path);
    const bool there = stat(path, &file) == 0;
    const char *why = NULL;
    if (there && !S_ISREG(file.st_mode))
        why = S_ISDIR(file.st_mode) ? "it is a folder" : "it is not a regular file";
    else if (lg_is_lost_link(path))
        why = LG_LOST_LINK;
    else if (path[0] == '\0' || stat(folder, &above) != 0)
        why = strerror(path[0] == '\0' ? ENOENT : errno);
    else if (!S_ISDIR(above.st_mode))
        why = strerror(ENOTDIR);
    else if (access(folder, W_OK | X_OK) != 0)
        why = strerror(errno);
    return why == NULL ? LG_OK : lg_fail(error, LG_FILE, "%s: cannot be written: %s", path, why);
}

/* ---- outputs ---- */

/* Returns the path with its folder resolved; if the folder does not exist, the path is unchanged. */
static char *resolved(const char *path) {
    APP_FREE char *folder = app_folder_of(path), *real = real_path(folder);
    return real != NULL ? app_format("%s/%s", real, app_name_of(path)) : app_format("%s", path);
}

bool app_same_file(const char *a, const char *b) {
    struct stat first, second;
    const bool has_first = stat(a, &first) == 0, has_second = stat(b, &second) == 0;
    if (has_first != has_second) return false;
    if (has_first) return first.st_dev == second.st_dev && first.st_ino == second.st_ino;
    APP_FREE char *p = resolved(a), *q = resolved(b);
    return strcmp(p, q) == 0;
}

#define PLOT_DATA "=" APP_PLOT_DATA "\n"

/* A file that a command writes. */
typedef struct written_file {
    const char *option; /* NULL for an argument */
    char *path;
    bool streamed;
    const char *begins; /* how an earlier result begins; NULL: not known before the file is written */
    const char *kind;   /* of a file in HDF5 */
} written_file;

/* A file that this process reads. */
typedef struct input {
    struct input *next;
    const char *option; /* NULL for an argument, and for a file that another input names */
    char *path;
} input;

static input *inputs;

static void add_input(const char *option, const char *path) {
    const input added = {inputs, option, app_format("%s", path)};
    inputs = memcpy(app_alloc(1, sizeof added), &added, sizeof added);
}

/* Removes the inputs that were added after `last`. */
static void drop_inputs(input *last) {
    while (inputs != last) {
        input *first = inputs;
        inputs = first->next;
        free(first->path);
        free(first);
    }
}

/* Lists the files that a command writes. `out` has room for 3 count: a plot has three files, the image, its
 * data and its script. */
static size_t list_outputs(const app_path *paths, size_t count, written_file *out) {
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        if (paths[i].path == NULL || paths[i].use == LG_FILE_READ) continue;
        const int stem = (int)strlen(paths[i].path) - 4;
        written_file *made = &out[n++];
        *made = (written_file){paths[i].option, app_format("%s", paths[i].path),
                               paths[i].use == LG_FILE_STREAMED, NULL, paths[i].kind};
        if (paths[i].use == LG_FILE_WRITTEN) made->begins = LG_H5_SIGNATURE;
        if (paths[i].use != LG_FILE_DRAWN) continue;
        made->begins = strcmp(paths[i].path + stem, ".png") == 0 ? "\x89PNG\r\n\x1a\n" : "<?xml";
        out[n++] = (written_file){paths[i].option, app_format("%.*s.dat", stem, paths[i].path), false,
                                  PLOT_DATA, NULL};
        out[n++] = (written_file){paths[i].option, app_format("%.*s.gp", stem, paths[i].path), false,
                                  APP_PLOT_SCRIPT, NULL};
    }
    return n;
}

/* Returns whether the file is a pipe or a device that may be written to directly, or a link to a file that is
 * made when it is opened. */
static bool is_stream(const written_file *file) {
    struct stat about;
    const bool there = stat(file->path, &about) == 0;
    return file->streamed &&
           (there ? !S_ISREG(about.st_mode) && !S_ISDIR(about.st_mode) : lg_is_lost_link(file->path));
}

/* Checks that the output files[at] can be written, and that it is neither an input nor one of the outputs
 * before it in the list. */
static void check_output(const app *self, const written_file *files, size_t at) {
    const written_file *file = &files[at];
    APP_FREE char *option = file->option != NULL ? app_format("--%s: ", file->option) : app_format("%s", "");
    if (!is_stream(file)) APP_MUST_FILE(self, file->path, app_check_writable(file->path, &error));
    for (const input *in = inputs; in != NULL; in = in->next)
        if (app_same_file(file->path, in->path))
            app_stop_usage(self, "%s%s is an input%s%s and would be replaced", option, file->path,
                           in->option != NULL ? " of --" : "", in->option != NULL ? in->option : "");
    for (size_t i = 0; i < at; i++)
        if (app_same_file(file->path, files[i].path))
            app_stop_usage(self, "%s%s is also %s%s", option, file->path,
                           files[i].option != NULL ? "the output file of --" : "an output file",
                           files[i].option != NULL ? files[i].option : "");
}

/* ---- outputs that this process has claimed ---- */

/* A file that this process writes, or a file or folder that it has claimed. */
typedef struct output {
    struct output *next;
    char *target;
    lg_lock lock;     /* of a claim */
    bool written;     /* this process has written the file, or continues it */
    const char *kind; /* of a file in HDF5 */
    /* the existing file, if it is an earlier result of the same kind; else 0 */
    dev_t device;
    ino_t inode;
} output;

static output *outputs;

void app_release_claims(void) {
    for (output *o = outputs; o != NULL; o = o->next)
        if (o->lock.fd >= 0) lg_lock_release(&o->lock);
}

/* The lock's target: `path` with links resolved and without slashes at its end. For a folder whose parent
 * folder cannot be written, a slash is appended, so that the lock file lies inside the folder. Freed with
 * free. */
static char *target_of(const char *path, bool folder) {
    APP_FREE char *named = app_format("%s", path);
    for (size_t n = strlen(named); n > 1 && named[n - 1] == '/'; n--) named[n - 1] = '\0';
    APP_FREE char *real = real_path(named);
    APP_FREE char *target = real != NULL ? app_format("%s", real) : resolved(named);
    APP_FREE char *above = app_format("%s/..", target);
    return app_format("%s%s", target, folder && access(above, W_OK) != 0 ? "/" : "");
}

static output *output_of(const char *path, bool folder) {
    char *target = target_of(path, folder);
    output *o = outputs;
    while (o != NULL && strcmp(o->target, target) != 0) o = o->next;
    if (o == NULL) {
        const output made = {.next = outputs, .target = target, .lock = {.fd = -1}};
        return outputs = memcpy(app_alloc(1, sizeof made), &made, sizeof made);
    }
    free(target);
    return o;
}

lg_status app_claim(const app *self, const char *path, lg_error *error) {
    static bool registered;
    struct stat about;
    if (self->rank > 0) return LG_OK;
    const bool there = stat(path, &about) == 0, folder = there && S_ISDIR(about.st_mode);
    if (there && !folder && !S_ISREG(about.st_mode)) return LG_OK;
    output *o = output_of(path, folder);
    if (o->lock.fd >= 0) return LG_OK;
    if (!registered) (void)atexit(app_release_claims);
    registered = true;
    return lg_lock_take(NULL, o->target, self->command_line, &o->lock, error);
}

/* ---- files that exist ---- */

bool app_begins(const char *path, const char *data, size_t bytes, int lines) {
    size_t n = lines > 0 ? 0 : bytes;
    for (int i = 0; i < lines && n < bytes; i++) {
        const char *end = memchr(data + n, '\n', bytes - n);
        n = end != NULL ? (size_t)(end - data) + 1 : bytes;
    }
    size_t got = 0;
    APP_FREE char *found = app_alloc(n + 1, 1);
    return lg_read_first(path, found, n + 1, &got, NULL) == LG_OK && got >= n &&
           memcmp(found, data, n) == 0 && (lines > 0 || got == n);
}

static bool is_detector(const char *kind) {
    return strcmp(kind, "detector") == 0 || strcmp(kind, "classifier") == 0;
}

/* Returns whether liegrad wrote the file in HDF5, and it is of this kind; detectors have two. */
static bool is_of_kind(const app *self, const char *path, const char *kind) {
    bool ours = false;
    char found[64] = "";
    if (kind == NULL || app_had_memory(lg_file_is_ours(self->context, path, &ours, NULL)) != LG_OK || !ours)
        return false;
    (void)app_had_memory(lg_model_file_kind(self->context, path, NULL, found, sizeof found, NULL));
    return strcmp(found, kind) == 0 || (is_detector(found) && is_detector(kind));
}

/* ---- tables that exist ---- */

/* The forms in which commands write numbers, one bit for each: those of lg_columns, and of the values and
 * times of a feed. Numbers of other programs seldom have 17 digits in all cells that need them. A number of
 * LONG bytes or more is a sign of lg_columns, because few numbers that people choose need 16 digits. */
enum { FORM_17 = 1, ALL_FORMS = 7, CELL = 64, LONG = 17 };

typedef struct table_rows {
    size_t count, longs; /* number of rows, and of long numbers in them */
} table_rows;

/* Returns a bit for each form that the cell lacks: no bit for 0 or an empty cell, all bits for a text. */
static unsigned lacking_forms(const char *cell) {
    double x;
    char digits[3][CELL];
    unsigned lacks = 0;
    if (lg_csv_missing(cell) || strcmp(cell, "0") == 0) return 0;
    if (lg_number_parse(cell, &x) != LG_OK) return ALL_FORMS;
    (void)lg_format(digits[0], CELL, "%.17g", x);
    (void)lg_format(digits[1], CELL, "%.8e", x);
    (void)lg_format(digits[2], CELL, "%.1f", x);
    for (int i = 0; i < 3; i++) lacks |= strcmp(cell, digits[i]) != 0 ? 1u << i : 0;
    return lacks;
}

/* Reads the rows that are left, and adds to lacks[c] each form that a cell of column c lacks. Cells in quotes
 * or with blanks around them are texts. Returns false if a row has too few or too many cells, a quote inside
 * a cell without quotes, or an end that lg_columns does not write. */
static bool read_rows(lg_csv *from, size_t columns, unsigned *lacks, table_rows *rows) {
    bool more = true;
    for (*rows = (table_rows){0};; rows->count++) {
        if (app_had_memory(lg_csv_next(from, &more, NULL)) != LG_OK || !more) return !more;
        if (!from->closed || strlen(from->line) != from->length) return false;
        char *begin = from->line, *next = begin, *cell;
        for (size_t c = 0; c < columns; begin = next, c++) {
            if (begin == NULL) return false;
            const size_t bytes = strcspn(begin, ",");
            if (lg_csv_cell(from, &next, &cell, NULL) != LG_OK ||
                (!from->quoted && strchr(cell, '"') != NULL))
                return false;
            const unsigned own = bytes == (from->quoted ? 2 : strlen(cell)) ? lacking_forms(cell) : ALL_FORMS;
            rows->longs += own != ALL_FORMS && bytes >= LONG;
            lacks[c] |= own;
        }
        if (begin != NULL) return false;
    }
}

/* Returns whether the file has rows like those of the table `data` with the same header: as many cells,
 * numbers of the same form in each column of numbers, and long ones if `data` has some. If `data` has no
 * rows, all columns must hold numbers, and some must be long. */
static bool has_such_rows(const char *path, const char *data, size_t bytes) {
    bool more, open;
    table_rows new, old;
    APP_CLEAN(lg_csv_close) lg_csv made, found;
    (void)app_had_memory(lg_csv_open_feed(NULL, -1, path, SIZE_MAX, NULL, NULL, &made, NULL));
    made.from = fmemopen((void *)(uintptr_t)data, bytes, "rb");
    if (made.from == NULL) app_out_of_memory();
    (void)app_had_memory(lg_csv_next(&made, &more, NULL));
    const size_t columns = lg_csv_count(made.line, ',', &open);
    APP_FREE unsigned *lacks = app_alloc(2 * columns, sizeof *lacks);
    bool same = app_had_memory(lg_csv_open(NULL, path, &found, NULL)) == LG_OK;
    made.separator = found.separator = ',';
    found.longest = SIZE_MAX;
    same = same && app_had_memory(lg_csv_next(&found, &more, NULL)) == LG_OK &&
           strcmp(made.line, found.line) == 0 && read_rows(&made, columns, lacks, &new) &&
           read_rows(&found, columns, lacks + columns, &old) && old.count > 0 &&
           (old.longs > 0 || (new.longs == 0 && new.count > 0));
    for (size_t c = 0; c < columns && same; c++) {
        const unsigned own = new.count > 0 ? lacks[c] : ALL_FORMS - FORM_17;
        same = own == ALL_FORMS || (own | lacks[columns + c]) != ALL_FORMS;
    }
    return same;
}

/* Returns whether the text is a table. The first line of all others, a comment, JSON, XML, the data of a plot
 * or bytes, is one that no other program writes. */
static bool is_table(const char *data, size_t bytes) {
    const char *end = memchr(data, '\n', bytes);
    bool plain = end != NULL && strchr("#={<", data[0]) == NULL;
    for (const char *c = data; plain && c < end; c++) plain = (unsigned char)*c >= ' ';
    return plain;
}

/* Returns whether the file that exists is an earlier result like `data`; `whole`: whether it equals them. */
static bool is_earlier(const app *self, const char *path, const char *kind, const char *data, size_t bytes,
                       bool whole) {
    static const char h5[] = LG_H5_SIGNATURE;
    if (bytes >= sizeof h5 - 1 && memcmp(data, h5, sizeof h5 - 1) == 0) return is_of_kind(self, path, kind);
    return app_begins(path, data, bytes, whole ? 0 : 1) &&
           (whole || !is_table(data, bytes) || has_such_rows(path, data, bytes));
}

void app_say_replaces(const app *self, const char *path) {
    app_put(stderr, "%s: %s: replaces an earlier result\n", self->title, path);
}

static lg_status may_write(const app *self, const char *path, const char *data, size_t bytes, bool whole,
                           bool now, lg_error *error) {
    struct stat about;
    output *of = output_of(path, false);
    const bool there = !of->written && stat(path, &about) == 0 && S_ISREG(about.st_mode) && about.st_size > 0,
               known = there && about.st_dev == of->device && about.st_ino == of->inode;
    if (there && !known && !is_earlier(self, path, of->kind, data, bytes, whole))
        return lg_fail(error, LG_FILE,
                       "%s: exists and is not an earlier result of this kind: move it away, or write to "
                       "another file",
                       path);
    if (there && now && !self->continues) app_say_replaces(self, path);
    if (there) of->device = about.st_dev, of->inode = about.st_ino;
    of->written = of->written || now;
    return LG_OK;
}

lg_status app_may_replace(void *user, const char *path, const void *data, size_t bytes, lg_error *error) {
    return may_write(user, path, data, bytes, false, true, error);
}

void app_reads(const app *self, const char *path) {
    for (const output *o = outputs; o != NULL; o = o->next)
        if (app_same_file(o->target, path))
            app_stop_usage(self, "%s is an input and would be replaced", path);
    add_input(NULL, path);
}

void app_continue(const char *path) {
    output_of(path, false)->written = true;
}

void app_check_text(const app *self, const char *path, const char *text) {
    if (path == NULL) return;
    APP_MUST_FILE(self, path, may_write(self, path, text, strlen(text), false, false, &error));
}

void app_write_texts(const app *self, const char *folder, const lg_named_text *texts) {
    for (int writing = 0; writing < 2; writing++)
        for (const lg_named_text *at = texts; at->name != NULL; at++) {
            app_file file;
            APP_FREE char *path = app_format("%s/%s", folder, at->name);
            const char *text = at->text;
            if (strstr(at->name, ".sh") != NULL) continue;
            APP_MUST_FILE(self, path, may_write(self, path, text, strlen(text), true, false, &error));
            if (!writing || output_of(path, false)->inode != 0) continue; /* inode: the text is there */
            app_file_begin(&file, path);
            (void)fputs(text, file.stream);
            APP_MUST_FILE(self, path, app_file_end(&file, &error));
        }
}

/* Checks that the output does not exist or is an earlier result. An image is an earlier result only if its
 * data lie next to it. */
static void check_earlier(const app *self, const written_file *file) {
    const char *path = file->path, *begins = file->begins;
    output *of = output_of(path, false); /* it adds the path to the outputs, which app_reads searches */
    of->kind = file->kind;
    if (begins == NULL) return;
    app_check_text(self, path, begins);
    const bool drawn = app_plot_name_fits(path);
    APP_FREE char *data = app_format("%s=%s\n", PLOT_DATA, drawn ? path + strlen(path) - 3 : "");
    if (drawn && of->inode != 0 && !app_begins(file[1].path, data, strlen(data), 2))
        app_stop(self, LG_FILE,
                 "%s: exists, and its data do not lie in %s: remove it, or write to another file", path,
                 file[1].path);
}

void app_check_outputs(const app *self, const app_path *more, size_t more_count) {
    app_path paths[APP_SLOTS + APP_MORE_PATHS];
    for (size_t i = 0; i < more_count; i++) paths[i] = more[i];
    const size_t count = more_count + app_file_options(self, paths + more_count);
    for (size_t i = 0; i < count; i++)
        if (paths[i].use == LG_FILE_DRAWN && paths[i].path != NULL && !app_plot_name_fits(paths[i].path))
            app_stop_usage(self, "--%s: '%s' does not end in .svg or .png", paths[i].option, paths[i].path);
    input *registered = inputs;
    for (int i = 0; i < self->argument_count; i++) add_input(NULL, self->arguments[i]);
    for (size_t i = 0; i < count; i++)
        if (paths[i].use == LG_FILE_READ && paths[i].path != NULL) add_input(paths[i].option, paths[i].path);
    written_file *files = app_alloc(3 * count, sizeof *files);
    const size_t n = list_outputs(paths, count, files);
    for (size_t i = 0; i < n; i++) check_output(self, files, i);
    for (size_t i = 0; i < n; i++) {
        APP_MUST_FILE(self, files[i].path, app_claim(self, files[i].path, &error));
        check_earlier(self, &files[i]);
    }
    for (size_t i = 0; i < n; i++) free(files[i].path);
    free(files);
    drop_inputs(registered);
}

const char *app_name_of(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash != NULL ? slash + 1 : path;
}

char *app_folder_of(const char *path) {
    const int length = (int)(app_name_of(path) - path);
    return length == 0 ? app_format(".") : app_format("%.*s", length > 1 ? length - 1 : 1, path);
}
