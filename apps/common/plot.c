/* gnuplot draws each plot from a fixed script and a data file. Both files stay in the folder of the plot. */
#include "common/app.h"

#include <errno.h>
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

void app_plot_words(app_plot *plot, char *words) {
    char *rest = words;
    while (rest != NULL) put_text(plot->texts.stream, strsep(&rest, "\t"));
    free(words);
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

void app_plot_gap(app_plot *plot) {
    if (plot->lined) (void)fputc('\n', plot->data.stream);
    plot->lined = false;
}

void app_plot_block(app_plot *plot) {
    (void)fputs(plot->filled ? "\n\n" : "nan nan nan nan nan nan\n\n\n", plot->data.stream);
    plot->filled = plot->lined = false;
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

/* Draws the image, or warns that it cannot be drawn. */
static lg_status draw(const app *self, const char *path, const char *data, const char *script,
                      lg_error *error) {
    app_file image;
    app_file_begin(&image, path);
    const int code = run_gnuplot(script, image.stream);
    if (code == 0) return app_file_end(&image, error);
    (void)fclose(image.stream);
    free(image.text);
    app_warn(self, "gnuplot %s, so %s is not drawn; its data and script are in %s and %s%s",
             code == 127 ? "is not installed" : "failed", path, data, script,
             code == 127 ? " (to draw it, in their folder: gnuplot -d ./SCRIPT > PLOT)" : "");
    return LG_OK;
}

app_plot_values app_plot_given;

void app_plot_row(const app *self, const app_plot_kind *row, const void *of) {
    const char *image = app_plot_given.plot;
    if (image == NULL) return;
    const int stem = (int)strlen(image) - 4;
    APP_FREE char *data_path = app_format("%.*s.dat", stem, image);
    APP_FREE char *script_path = app_format("%.*s.gp", stem, image);
    app_plot plot = {.kind = row->name, .script = row->script};
    app_file script;
    lg_error error = {LG_OK, ""};
    app_file_begin(&plot.texts, data_path);
    app_file_begin(&plot.data, data_path);
    app_plot_text(&plot, APP_PLOT_DATA "\t%s", image + stem + 1);
    row->put(&plot, of);
    if (fclose(plot.data.stream) != 0) app_out_of_memory();
    (void)fputs("\n\n", plot.texts.stream);
    (void)fwrite(plot.data.text, 1, plot.data.length, plot.texts.stream);
    free(plot.data.text);
    app_must_file(self, app_file_end(&plot.texts, &error), &error, image);
    app_file_begin(&script, script_path);
    (void)fprintf(script.stream, "%s\n%s", lg_named_text_of(app_plot_scripts, "begin"),
                  lg_named_text_of(app_plot_scripts, plot.script));
    lg_status status = app_file_end(&script, &error);
    const bool scripted = status == LG_OK;
    if (scripted) status = draw(self, image, data_path, script_path, &error);
    /* If no image exists, not even an earlier one, the data and the script are removed, too. */
    const bool useless = status != LG_OK && access(image, F_OK) != 0;
    if (useless) (void)unlink(data_path);
    if (useless && scripted) (void)unlink(script_path);
    app_must_file(self, status, &error, image);
}

/* ---- the plots of a command ---- */

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
    while (at->name != NULL && (at->usual == 0 || (at->usual & ~has) != 0)) at++;
    return at->name != NULL ? at : kinds;
}

void app_plot_check(const app *self, unsigned has) {
    const app_plot_kind *kind = app_plot_given.plot != NULL ? kind_of(has) : NULL;
    if (kind != NULL && (kind->needs & ~has) != 0)
        app_stop_usage(self, "--plot-kind %s: %s", kind->name, kind->missing);
}

void app_plot_draw(const app *self, unsigned has, const void *of) {
    if (app_plot_given.plot == NULL) return;
    app_plot_check(self, has);
    app_plot_row(self, kind_of(has), of);
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
