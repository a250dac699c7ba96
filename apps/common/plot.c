/* gnuplot draws each plot from a fixed script and a data file. Both files stay in the folder of the plot. */
#include "common/app.h"

#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

bool app_plot_name_fits(const char *image) {
    const size_t length = strlen(image);
    return length > 4 && (strcmp(image + length - 4, ".svg") == 0 || strcmp(image + length - 4, ".png") == 0);
}

/* Writes a line of block 0. gnuplot reads = and the rest of the line as one text. It reads \ and all octal
 * digits after it as one byte, so an octal digit after such a byte is written in octal too. */
static void put_text(FILE *stream, const char *text) {
    bool octal = false;
    (void)fputc('=', stream);
    for (const unsigned char *c = (const unsigned char *)text; *c != '\0'; c++) {
        octal = *c < ' ' || *c == '"' || *c == '\\' || *c == 0x7f || (octal && *c >= '0' && *c <= '7');
        (void)fprintf(stream, octal ? "\\%03o" : "%c", *c);
    }
    (void)fputc('\n', stream);
}

void app_plot_text(app_plot *plot, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    APP_FREE char *text = app_shown_list(format, arguments);
    va_end(arguments);
    char *rest = text;
    while (rest != NULL) put_text(plot->texts.stream, strsep(&rest, "\t"));
}

bool app_plot_begin(app_plot *plot, const char *script) {
    const char *image = app_plot_given.plot;
    if (image == NULL) return false;
    const int stem = (int)strlen(image) - 4;
    *plot = (app_plot){.script = app_text_of(app_plot_scripts, script), .image = app_format("%s", image)};
    plot->data_path = app_format("%.*s.dat", stem, image);
    plot->script_path = app_format("%.*s.gp", stem, image);
    app_file_begin(&plot->texts, plot->data_path);
    app_file_begin(&plot->data, plot->data_path);
    app_plot_text(plot, APP_PLOT_DATA "\t%s", image + stem + 1);
    return true;
}

void app_plot_columns(app_plot *plot, int digits, size_t rows, const app_plot_column *columns, size_t count) {
    for (size_t i = 0; i < rows; i++) {
        const char *between = "";
        for (const app_plot_column *at = columns; at < columns + count; at++)
            for (size_t j = 0; j < at->count; j++, between = " ")
                (void)fprintf(plot->data.stream, "%s%.*g", between, digits, at->x[i * at->stride + j]);
        (void)fputc('\n', plot->data.stream);
        plot->filled = plot->lined = true;
    }
}

void app_plot_numbers(app_plot *plot, int digits, const double *x, size_t count) {
    APP_PLOT_COLUMNS(plot, digits, 1, {x, 0, count});
}

void app_plot_gap(app_plot *plot) {
    if (plot->lined) (void)fputc('\n', plot->data.stream);
    plot->lined = false;
}

void app_plot_block(app_plot *plot) {
    (void)fputs(plot->filled ? "\n\n" : "nan nan nan nan nan nan\n\n\n", plot->data.stream);
    plot->filled = plot->lined = false;
}

/* Writes the texts and the numbers, with two empty lines between them. */
static lg_status write_data(app_plot *plot, lg_error *error) {
    if (fclose(plot->data.stream) != 0) app_out_of_memory();
    (void)fputs("\n\n", plot->texts.stream);
    (void)fwrite(plot->data.text, 1, plot->data.length, plot->texts.stream);
    free(plot->data.text);
    return app_file_end(&plot->texts, error);
}

static lg_status write_script(const app_plot *plot, lg_error *error) {
    app_file file;
    app_file_begin(&file, plot->script_path);
    (void)fprintf(file.stream, "%s\n%s", app_text_of(app_plot_scripts, "begin"), plot->script);
    return app_file_end(&file, error);
}

/* Copies everything from a pipe to `to`, until the pipe's end. Returns false if the pipe cannot be read. */
static bool drain(int from, FILE *to) {
    char buffer[65536];
    ssize_t got;
    while ((got = read(from, buffer, sizeof buffer)) > 0 || (got < 0 && errno == EINTR))
        if (got > 0) (void)fwrite(buffer, 1, (size_t)got, to);
    return got == 0;
}

/* Runs gnuplot in the script's folder, without its start-up files, and copies its standard output to
 * `image`. The name of the script is given as ./NAME, because gnuplot starts a program if a name begins
 * with < or |. Returns gnuplot's exit status: 127 if gnuplot is not installed, -1 if it could not be started,
 * was killed, or its output could not be read. gnuplot does not notice a full disk, so the caller writes the
 * image. */
static int run_gnuplot(const char *script, FILE *image) {
    const char *name = app_name_of(script);
    APP_FREE char *above = app_format("%.*s", (int)(name - script), script);
    APP_FREE char *folder = app_quote(above), *file = app_quote(name);
    APP_FREE char *command = app_format("(cd %s%s && exec gnuplot -d ./%s) < /dev/null 2> /dev/null",
                                        *script == '/' ? "" : "./", folder, file);
    FILE *pipe = popen(command, "r");
    if (pipe == NULL) return -1;
    const bool whole = drain(fileno(pipe), image);
    const int status = pclose(pipe);
    return WIFEXITED(status) && (whole || WEXITSTATUS(status) != 0) ? WEXITSTATUS(status) : -1;
}

/* Draws the plot, or warns that it cannot be drawn. */
static lg_status draw(const app *self, const app_plot *plot, lg_error *error) {
    app_file image;
    app_file_begin(&image, plot->image);
    const int code = run_gnuplot(plot->script_path, image.stream);
    if (code == 0) return app_file_end(&image, error);
    app_file_discard(&image);
    app_warn(self, "gnuplot %s, so %s is not drawn; its data and script are in %s and %s%s",
             code == 127 ? "is not installed" : "failed", plot->image, plot->data_path, plot->script_path,
             code == 127 ? " (to draw it, in their folder: gnuplot -d ./SCRIPT > PLOT)" : "");
    return LG_OK;
}

void app_plot_end(const app *self, app_plot *plot) {
    lg_error error = {LG_OK, ""};
    lg_status status = write_data(plot, &error);
    const bool data = status == LG_OK;
    if (data) status = write_script(plot, &error);
    const bool script = data && status == LG_OK;
    if (script) status = draw(self, plot, &error);
    /* The data and the script are of no use when the disk is full and the rest is missing. */
    if (status != LG_OK && data) (void)unlink(plot->data_path);
    if (status != LG_OK && script) (void)unlink(plot->script_path);
    app_must_file(self, status, &error, plot->image);
    char *const texts[] = {plot->image, plot->data_path, plot->script_path};
    for (size_t i = 0; i < LG_COUNT(texts); i++) free(texts[i]);
}

/* ---- the plots of a command ---- */

app_plot_values app_plot_given;
static const app_plot_kind *kinds; /* of the command */

static const char *kind_name(uint32_t value) {
    const app_plot_kind *at = kinds;
    while (value > 1 && at->name != NULL) at++, value--;
    return value == 0 ? "default" : at->name;
}

const lg_field *app_plot_options(const app_plot_kind *plots) {
    static char drawn[256], listed[1024];
    static lg_field rows[] = {
        LG_OPTION(app_plot_values, plot, STRING, "FILE.svg|.png", drawn, .file = LG_FILE_DRAWN,
                  .usual = true),
        LG_OPTION(app_plot_values, plot_kind, NAME, NULL, listed, .needs = "plot", .value_name = kind_name),
        LG_FIELD_END};
    const bool one = plots[1].name == NULL;
    kinds = plots;
    rows[1].name = one ? NULL : "plot_kind";
    (void)snprintf(drawn, sizeof drawn,
                   "Draw %s; its data and script stay next to it, as FILE.dat and FILE.gp",
                   one ? plots->help : "a plot");
    listed[0] = '\0';
    for (const app_plot_kind *at = plots; at->name != NULL; at++)
        lg_append(listed, sizeof listed, "%s%s (%s)", at == plots ? "With --plot: " : ", ", at->name,
                  at->help);
    lg_append(listed, sizeof listed, "; the default suits the data and the model");
    return rows;
}

static const app_plot_kind *kind_of(unsigned has) {
    const app_plot_kind *at = kinds;
    if (app_plot_given.plot_kind > 0) return kinds + app_plot_given.plot_kind - 1;
    while (at->usual == 0 || (at->usual & ~has) != 0) at++;
    return at;
}

void app_plot_check(const app *self, unsigned has) {
    const app_plot_kind *kind = app_plot_given.plot != NULL ? kind_of(has | APP_PLOT_ANY) : NULL;
    if (kind != NULL && (kind->needs & ~has) != 0)
        app_stop_usage(self, "--plot-kind %s: %s", kind->name, kind->missing);
}

void app_plot_draw(const app *self, unsigned has, const void *of) {
    if (app_plot_given.plot == NULL) return;
    const app_plot_kind *kind = kind_of(has | APP_PLOT_ANY);
    app_plot plot;
    app_plot_check(self, has);
    if (kind->script != NULL && app_plot_begin(&plot, kind->script)) plot.kind = kind->name;
    kind->put(&plot, of);
    app_plot_end(self, &plot);
}

/* ---- confusion matrices ---- */

void app_plot_confusion(app_plot *plot, const char *title, const uint64_t *confusion, uint32_t classes,
                        char (*class_name)[APP_CLASS_NAME]) {
    app_plot_text(plot, "%u\t%s", classes, title);
    for (uint32_t row = 0; row < classes; row++) {
        app_plot_text(plot, "%s", class_name[row]);
        for (uint32_t j = 0; j < classes; j++)
            APP_PLOT_ROW(plot, 15, j, row, (double)confusion[(size_t)row * classes + j]);
    }
}
