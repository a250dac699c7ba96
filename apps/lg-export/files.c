/* The exported files: what stands around the functions in NAME.h and NAME.c, the files of weights and of the
 * self-test, the Makefile; and how all files are written to the disk. */
#include "lg-export/export.h"
#include "files/temporary.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* ---- NAME.h ---- */

enum { COLUMNS = 105, HANGING = 14 };

/* Adds the line up to `end` as lines of a comment. Long lines are broken at blanks, but never after a
 * backslash. */
static void add_wrapped(text *to, const char *line, const char *end) {
    for (size_t indent = 0; line < end || indent == 0; indent = HANGING) {
        const size_t room = COLUMNS - indent;
        const char *stop = end;
        if ((size_t)(end - line) > room) {
            for (stop = line + room; stop > line && (*stop != ' ' || stop[-1] == '\\'); stop--) continue;
            if (stop == line)
                for (stop = line + room; stop < end && (*stop != ' ' || stop[-1] == '\\'); stop++) continue;
        }
        const char *last = stop;
        while (last > line && last[-1] == ' ') last--;
        lg_text_add(to, last > line ? " * %*s%.*s\n" : " *\n", last > line ? (int)indent : 0, "",
                    (int)(last - line), line);
        for (line = stop; line < end && *line == ' '; line++) continue;
        if (line == end) return;
    }
}

/* Adds lines (without comment signs, any bytes) as lines inside a comment, and breaks long ones. */
static void add_lines(text *to, const char *lines) {
    APP_CLEAN(lg_text_destroy) text safe = app_text();
    lg_text_add_comment(&safe, lines != NULL ? lines : "");
    for (const char *line = safe.data; line != NULL && *line != '\0';) {
        const char *end = line + strcspn(line, "\n");
        add_wrapped(to, line, end);
        line = *end == '\n' ? end + 1 : end;
    }
}

void export_tell_words(const export_source *source, text *to) {
    if (source->state.length > 0) lg_text_add(to, "x             %s\n", source->state.data);
    if (source->input.length > 0) lg_text_add(to, "u             %s\n", source->input.data);
    if (source->delay.length > 0)
        lg_text_add(to, "delay         %s; these functions take them at once: delay them yourself\n",
                    source->delay.data);
}

void export_add_words(const export_source *source, text *to) {
    APP_CLEAN(lg_text_destroy) text lines = app_text();
    export_tell_words(source, &lines);
    add_lines(to, lines.data);
}

static const char unfit_inputs[] =
    " * A number of x that is not finite makes all results of NAME_eval and NAME_grad NaN.\n";
static const char unfit_bundle[] =
    " * A number of an input that is not finite makes all results of a function NaN. An output may be NULL: "
    "not\n * wanted. NAME_<function>_WORK_SIZE numbers of work memory are enough for one function.\n";

static const char flags[] =
    " * Not for -ffast-math. Loops are written for the vectoriser of the compiler: -O3, the instruction set\n"
    " * of the target (-march=native, -mcpu=...), -ffp-contract=fast where it has fused multiply-add.\n"
    " */\n";

static const char gradient[] =
    "/* jacobian (NAME_OUTPUTS, NAME_INPUTS), row by row: the derivative of output o by input i is\n"
    " * jacobian[o * NAME_INPUTS + i]. y (NAME_OUTPUTS) or NULL. */\n"
    "void NAME_grad(const NAME_real *x, NAME_real *y, NAME_real *jacobian, NAME_real *work);\n";

static const char *or_nothing(const text *from) {
    return from->data != NULL ? from->data : "";
}

static const char eval[] = "/* x (NAME_INPUTS) -> y (NAME_OUTPUTS) */\n"
                           "void NAME_eval(const NAME_real *x, NAME_real *y, NAME_real *work);\n";

static void add_sizes(const export_source *source, text *to) {
    const char *name = source->options->name, *sizes = or_nothing(&source->sizes),
               *type = source->options->dtype == LG_F32 ? "float" : "double";
    if (source->bundle)
        lg_text_add(to, "%s", sizes);
    else
        lg_text_add(to,
                    "typedef %s %s_real;\n\n#define %s_INPUTS %zu\n#define %s_OUTPUTS %zu\n"
                    "#define %s_WORK_SIZE %zu /* numbers of work memory */\n",
                    type, name, name, source->inputs, name, source->outputs, name, source->work);
    export_add_named(source, export_fragment_text("sizes.cin"), to);
    lg_text_add(to, "#define %s_TOLERANCE ", name);
    lg_text_add_real(to, LG_F64, export_tolerance(source));
    lg_text_add(to, "\n%s\n", source->bundle ? "" : sizes);
}

static void add_header(const export_source *source, text *to) {
    const char *name = source->options->name, *sha256 = source->options->sha256;
    const bool valued = !source->bundle && source->outputs > 0;
    lg_text_add(to, "/* %s: written by lg-export of liegrad %s from the model ", name, lg_version());
    lg_text_add_comment(to, source->options->file);
    lg_text_add(to, "\n * (SHA-256 %s).\n *\n", sha256[0] != '\0' ? sha256 : "unknown");
    add_lines(to, source->about.data);
    lg_text_add_named(to, name, export_fragment_text("usage.cin"));
    if (source->bundle || valued) lg_text_add_named(to, name, valued ? unfit_inputs : unfit_bundle);
    lg_text_add(to, "%s#ifndef %s_H\n#define %s_H\n\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n\n", flags,
                name, name);
    add_sizes(source, to);
    if (valued) lg_text_add_named(to, name, eval);
    if (source->golden.jacobian != NULL) lg_text_add_named(to, name, gradient);
    lg_text_add(to, "%s\n#ifdef __cplusplus\n}\n#endif\n\n#endif\n", or_nothing(&source->declarations));
}

/* ---- the other four files ---- */

static void add_code(const export_source *source, text *to) {
    const char *name = source->options->name;
    lg_text_add(to, "/* %s.h says what this is. */\n#include \"%s.h\"\n\n#include <stddef.h>\n%s\n%s", name,
                name, or_nothing(&source->arrays), or_nothing(&source->code));
}

static void add_weights(const export_source *source, text *to) {
    const char *name = source->options->name;
    lg_text_add(
        to,
        "/* The numbers of %s; the comment below a line holds the same ones in hexadecimal, exactly. Written "
        "by\n * lg-export. */\n#include \"%s.h\"\n",
        name, name);
    lg_text_add(to, "%s%s", or_nothing(&source->arrays), or_nothing(&source->weights));
}

static void add_test(const export_source *source, text *to) {
    const char *name = source->options->name;
    lg_text_add(
        to,
        "/* Self-test of %s: golden vectors, computed in double precision by the library that trained the\n"
        " * model. Written by lg-export. */\n#include \"%s.h\"\n\n#include <math.h>\n#include <stddef.h>\n"
        "#include <stdio.h>\n#include <string.h>\n#include <float.h>\n\ntypedef %s_real real;\n\n",
        name, name, name);
    if (source->bundle)
        lg_text_add(to, "%s", or_nothing(&source->test));
    else
        export_golden_write(source, to);
}

void export_add_named(const export_source *source, const char *lines, text *to) {
    char times[64] = "";
    if (source->condition != 1)
        (void)lg_format(times, sizeof times, " times the condition %.6g", source->condition);
    const struct {
        const char *token, *text;
        size_t number; /* Used where text is NULL. */
    } rows[] = {{"NAME_.", source->options->name, 0}, {"NAME_", source->options->name, 0},
                {"%NAME%", source->options->name, 0}, {"%ALL%", or_nothing(&source->products), 0},
                {"%STACK%", NULL, source->stack},     {"%CALLS%", NULL, source->calls},
                {"%DEPTH%", NULL, source->depth},     {"%TIMES%", times, 0}};
    for (const char *s = lines; *s != '\0'; s++) {
        size_t i = 0;
        while (i < LG_COUNT(rows) && strncmp(s, rows[i].token, strlen(rows[i].token)) != 0) i++;
        if (i == LG_COUNT(rows)) {
            lg_text_append(to, s, 1);
            continue;
        }
        if (rows[i].text != NULL)
            lg_text_add(to, "%s%s", rows[i].text, i == 0 ? "." : i == 1 ? "_" : "");
        else
            lg_text_add(to, "%zu", rows[i].number);
        s += strlen(rows[i].token) - 1;
    }
}

void export_add_rules(export_source *source, const char *products, const char *rules) {
    lg_text_add(&source->products, " ");
    export_add_named(source, products, &source->products);
    export_add_named(source, rules, &source->rules);
}

/* Adds the Makefile and, behind it, the rules of the target. */
static void add_rules(const export_source *source, text *to) {
    export_add_named(source, export_fragment_text("makefile.gmake"), to);
    if (source->rules.length > 0) lg_text_add(to, "\n%s", source->rules.data);
}

static const struct {
    const char *name; /* %s stands for the model's name. */
    void (*add)(const export_source *source, text *to);
} composers[] = {{"%s.h", add_header},
                 {"%s.c", add_code},
                 {"%s_weights.c", add_weights},
                 {"%s_test.c", add_test},
                 {"Makefile", add_rules}};

/* Adds the beginning by which lg-export recognises a file as its own. Formats without comments get none. */
static void add_marker(const char *file, const char *name, text *to) {
    const char *dot = strrchr(file, '.');
    const bool c = dot != NULL && (strcmp(dot, ".c") == 0 || strcmp(dot, ".h") == 0);
    if (c)
        lg_text_add(to, "/* lg-export: %s */\n", name);
    else if (dot != NULL && strcmp(dot, ".xml") == 0)
        lg_text_add(to, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- lg-export: %s -->\n", name);
    else if (strcmp(file, "Makefile") == 0 || strcmp(file, "CMakeLists.txt") == 0)
        lg_text_add(to, "# lg-export: %s\n", name);
}

text *export_add_file(export_source *source, const char *name) {
    export_file *file = &source->files[source->file_count++];
    file->name = app_format(name, source->options->name);
    file->content = app_text();
    add_marker(file->name, source->options->name, &file->content);
    return &file->content;
}

void export_compose(export_source *source) {
    for (size_t i = 0; i < LG_COUNT(composers); i++)
        composers[i].add(source, export_add_file(source, composers[i].name));
}

/* ---- writing to the disk ---- */

typedef struct place {
    const export_source *source;
    const char *out;    /* Without slashes at its end. */
    const char *parent; /* The folder that contains `out`. */
    bool replace;       /* True: `out` is a folder that already has files. */
    bool earlier;       /* some files replace earlier ones */
    lg_temporary holds; /* The folder in which the files are written first. */
} place;

static lg_status place_error(const place *at, const char *what, int code, lg_error *error) {
    return lg_fail(error, lg_status_of(code), "%s: %s: %s", at->out, what, strerror(code));
}

static bool is_empty_folder(const char *path) {
    struct stat information;
    if (lstat(path, &information) != 0 || !S_ISDIR(information.st_mode)) return false;
    DIR *folder = opendir(path);
    if (folder == NULL && errno == ENOMEM) app_out_of_memory();
    if (folder == NULL) return false;
    bool empty = true;
    for (struct dirent *entry; empty && (entry = readdir(folder)) != NULL;)
        empty = strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0;
    (void)closedir(folder);
    return empty;
}

/* Returns whether lg-export wrote the file for this model's name: the file begins with the marker line, or,
 * in formats without one, has the words "lg-export: NAME" among its first 511 bytes. */
static bool is_ours(const place *at, size_t file, const char *path) {
    char found[512];
    APP_CLEAN(lg_text_destroy) text marker = app_text();
    const char *name = at->source->options->name;
    APP_FREE char *words = app_format("lg-export: %s", name);
    FILE *stream = fopen(path, "rb");
    if (stream == NULL && errno == ENOMEM) app_out_of_memory();
    const size_t n = stream != NULL ? fread(found, 1, sizeof found - 1, stream) : 0;
    found[n] = '\0';
    if (stream != NULL) (void)fclose(stream);
    add_marker(at->source->files[file].name, name, &marker);
    const char *mark = memmem(found, n, words, strlen(words));
    return marker.length > 0 ? n >= marker.length && memcmp(found, marker.data, marker.length) == 0
                             : mark != NULL && !lg_in_word(mark[strlen(words)]);
}

/* Checks that the name of a file is free, or taken by a file that lg-export wrote for the same model name. */
static lg_status look_at(place *at, size_t file, lg_error *error) {
    struct stat information;
    APP_FREE char *path = app_format("%s/%s", at->out, at->source->files[file].name);
    if (lstat(path, &information) != 0) return LG_OK;
    at->earlier = true;
    if (!S_ISREG(information.st_mode))
        return lg_fail(error, LG_FILE, "%s: exists and is not a regular file", path);
    if (is_ours(at, file, path)) return LG_OK;
    return lg_fail(error, LG_FILE,
                   "%s: exists and was not written by lg-export for the name %s: choose another folder for "
                   "each model",
                   path, at->source->options->name);
}

/* Checks that the folder exists in which `out` is to be made. */
static lg_status look_above(const place *at, lg_error *error) {
    struct stat information;
    if (stat(at->parent, &information) == 0 || errno != ENOENT) return LG_OK;
    return lg_fail(error, LG_FILE, "%s: cannot be made: there is no folder %s, make that first", at->out,
                   at->parent);
}

/* Checks that `out` can be written: it does not exist, or it is an empty folder, or a folder in which every
 * file name is free or taken by a file that lg-export wrote for this model name. */
static lg_status look(place *at, lg_error *error) {
    struct stat information;
    if (stat(at->out, &information) != 0)
        return errno == ENOENT ? LG_OK : place_error(at, "cannot be written", errno, error);
    if (!S_ISDIR(information.st_mode)) return place_error(at, "cannot be written", ENOTDIR, error);
    at->replace = !is_empty_folder(at->out);
    for (size_t i = 0; i < at->source->file_count && at->replace; i++) LG_TRY(look_at(at, i, error));
    return LG_OK;
}

/* Makes the temporary folder: inside `out` if `out` keeps its other files, otherwise next to it. */
static lg_status make_temporary(const app *self, place *at, lg_error *error) {
    APP_FREE char *target = app_format("%s%s", at->out, at->replace ? "/" : "");
    return lg_temporary_create(self->context, target, true, &at->holds, error);
}

/* From the first write on (this function to remove_temporary), nothing may allocate: a program that stops
 * because memory ran out would leave some of the files behind. */
static int write_whole(int folder, const char *name, const text *content) {
    const int fd = openat(folder, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0) return errno;
    int code = lg_write_all(fd, content->data, content->length);
    if (code == 0) code = lg_sync(fd);
    if (close(fd) != 0 && code == 0 && errno != EINTR) code = errno;
    return code;
}

static lg_status write_files(place *at, lg_error *error) {
    for (size_t i = 0; i < at->source->file_count; i++) {
        const export_file *file = &at->source->files[i];
        const int code = write_whole(at->holds.fd, file->name, &file->content);
        if (code != 0) return place_error(at, "cannot be written", code, error);
        if (app_interrupted())
            return lg_fail(error, LG_CANCELLED, "%s: stopped, nothing is written", at->out);
    }
    (void)fsync(at->holds.fd);
    return LG_OK;
}

static lg_status rename_files(place *at, lg_error *error) {
    const int out = open(at->out, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int code = out < 0 ? errno : 0;
    for (size_t i = 0; i < at->source->file_count && code == 0; i++) {
        const char *name = at->source->files[i].name;
        if (renameat(at->holds.fd, name, out, name) != 0) code = errno;
    }
    if (code == 0) (void)rmdir(at->holds.name);
    if (out >= 0) (void)fsync(out);
    if (out >= 0) (void)close(out);
    return code == 0 ? LG_OK : place_error(at, "cannot be written", code, error);
}

static lg_status rename_folder(place *at, lg_error *error) {
    struct stat old;
    if (stat(at->out, &old) == 0) (void)chmod(at->holds.name, old.st_mode & 07777);
    return lg_temporary_publish(&at->holds, at->out, error);
}

static void remove_temporary(place *at) {
    for (size_t i = 0; i < at->source->file_count; i++)
        (void)unlinkat(at->holds.fd, at->source->files[i].name, 0);
    (void)rmdir(at->holds.name);
}

static lg_status put(const app *self, place *at, lg_error *error) {
    LG_TRY(look_above(at, error));
    LG_TRY(app_claim(self, at->out, error));
    LG_TRY(look(at, error));
    if (at->earlier) app_say_replaces(self, at->out);
    LG_TRY(make_temporary(self, at, error));
    lg_status status = write_files(at, error);
    if (status == LG_OK) status = at->replace ? rename_files(at, error) : rename_folder(at, error);
    if (status != LG_OK) remove_temporary(at);
    lg_temporary_end(&at->holds);
    return status;
}

static lg_status refuse_unfit(const export_source *source, const char *does, lg_error *error) {
    return lg_fail(
        error, LG_NOT_FINITE, "%s: %s numbers that are not finite or too large%s", source->options->file,
        does, source->options->dtype == LG_F32 ? " in single precision: export it with --dtype f64" : "");
}

void export_write(const app *self, const export_source *source, const char *out) {
    lg_error error = {LG_OK, ""};
    APP_FREE char *folder = app_format("%s", out);
    for (size_t n = strlen(folder); n > 1 && folder[n - 1] == '/'; n--) folder[n - 1] = '\0';
    APP_FREE char *parent = app_folder_of(folder);
    place at = {.source = source, .out = folder, .parent = parent};
    bool unfit = source->weights.unfit || source->code.unfit || source->sizes.unfit || source->test.unfit;
    for (size_t i = 0; i < source->file_count; i++) unfit = unfit || source->files[i].content.unfit;
    const lg_status status = unfit                         ? refuse_unfit(source, "holds", &error)
                             : !export_golden_fits(source) ? refuse_unfit(source, "gives", &error)
                                                           : put(self, &at, &error);
    app_must_file(self, status, &error, out);
}
