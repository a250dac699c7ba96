/* gnuplot draws the pictures from a script and data, which stay in the folder of the picture. */
#include "common/app.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

/* Ending of the file name, gnuplot's name of the terminal, and the terminal options that follow the size. */
static const struct {
    const char *ending, *terminal, *rest;
} formats[] = {{".svg", "svg", "dynamic background rgb 'white' font 'Helvetica,13'"},
               {".png", "pngcairo", "font 'Helvetica,11'"}};

static size_t format_of(const char *picture) {
    const size_t length = strlen(picture);
    for (size_t i = 0; i < LG_COUNT(formats); i++)
        if (length > 4 && strcmp(picture + length - 4, formats[i].ending) == 0) return i;
    return LG_COUNT(formats);
}

bool app_plot_name_fits(const char *picture) {
    return format_of(picture) < LG_COUNT(formats);
}

/* Writes text as a gnuplot string in single quotes; a quote inside is doubled. */
static void put_quoted(FILE *stream, const char *text) {
    (void)fputc('\'', stream);
    for (; *text != '\0'; text++) {
        if (*text == '\'') (void)fputc('\'', stream);
        (void)fputc(*text, stream);
    }
    (void)fputc('\'', stream);
}

void app_plot_begin(app_plot *plot, const char *picture, int width, int height) {
    const size_t format = format_of(picture) % LG_COUNT(formats);
    const int stem = (int)strlen(picture) - 4;
    const char *slash = strrchr(picture, '/');
    *plot = (app_plot){.picture = app_format("%s", picture)};
    plot->data_path = app_format("%.*s.dat", stem, picture);
    plot->script_path = app_format("%.*s.gp", stem, picture);
    app_file_begin(&plot->data, plot->data_path);
    app_file_begin(&plot->script, plot->script_path);
    FILE *script = plot->script.stream;
    (void)fprintf(script, "set terminal %s size %d,%d %s", formats[format].terminal, width, height,
                  formats[format].rest);
    (void)fputs("\ndatafile = ", script);
    put_quoted(script, plot->data_path + (slash != NULL ? slash + 1 - picture : 0));
    (void)fputs("\nset grid lc rgb '#dddddd'\nset border lc rgb '#555555'\n", script);
}

void app_plot_block(app_plot *plot) {
    (void)fputs("\n\n", plot->data.stream);
}

/* Copies everything from a pipe to `to`, until the pipe's end. Returns false if the pipe cannot be read. */
static bool drain(int from, FILE *to) {
    char buffer[65536];
    ssize_t got;
    while ((got = read(from, buffer, sizeof buffer)) > 0 || (got < 0 && errno == EINTR))
        if (got > 0) (void)fwrite(buffer, 1, (size_t)got, to);
    return got == 0;
}

/* Runs `gnuplot script` in the script's folder and copies its standard output, the picture, to `picture`.
 * Returns gnuplot's exit status: 127 if gnuplot is not installed, -1 if it could not be started or was
 * killed, or if its output could not be read. The caller then writes the picture completely or not at all;
 * gnuplot itself does not notice a full disk. */
static int run_gnuplot(const char *script, FILE *picture) {
    int ends[2];
    if (pipe(ends) != 0) return -1;
    const pid_t child = fork();
    if (child == 0) {
        const int null = open("/dev/null", O_RDWR);
        if (null >= 0) {
            (void)dup2(null, STDIN_FILENO);
            (void)dup2(null, STDERR_FILENO);
        }
        (void)dup2(ends[1], STDOUT_FILENO);
        (void)close(ends[0]);
        (void)close(ends[1]);
        const char *slash = strrchr(script, '/');
        const size_t folder = slash != NULL ? (size_t)(slash - script) + 1 : 0;
        char path[PATH_MAX];
        if (folder >= sizeof path) _exit(1);
        (void)snprintf(path, sizeof path, "%.*s", (int)folder, script);
        if (folder > 0 && chdir(path) != 0) _exit(1);
        (void)execlp("gnuplot", "gnuplot", script + folder, (char *)NULL);
        _exit(127);
    }
    (void)close(ends[1]);
    const bool whole = child > 0 && drain(ends[0], picture);
    (void)close(ends[0]);
    if (child < 0) return -1;
    int status = 0;
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR) return -1;
    return WIFEXITED(status) && (whole || WEXITSTATUS(status) != 0) ? WEXITSTATUS(status) : -1;
}

/* Draws the picture, or warns that it cannot be drawn. */
static lg_status draw(const app *self, const app_plot *plot, lg_error *error) {
    app_file picture;
    app_file_begin(&picture, plot->picture);
    const int code = run_gnuplot(plot->script_path, picture.stream);
    if (code == 0) return app_file_end(&picture, error);
    app_file_discard(&picture);
    app_warn(self, "gnuplot %s, so %s is not drawn; its data and script are in %s and %s%s",
             code == 127 ? "is not installed" : "failed", plot->picture, plot->data_path, plot->script_path,
             code == 127 ? " (to draw it, in their folder: gnuplot SCRIPT > PICTURE)" : "");
    return LG_OK;
}

lg_status app_plot_end(const app *self, app_plot *plot, lg_error *error) {
    lg_status status = app_file_end(&plot->data, error);
    const bool data = status == LG_OK;
    if (data)
        status = app_file_end(&plot->script, error);
    else
        app_file_discard(&plot->script);
    const bool script = data && status == LG_OK;
    if (script) status = draw(self, plot, error);
    /* The data and the script are of no use when the disk is full and the rest is missing. */
    if (status != LG_OK && data) (void)unlink(plot->data_path);
    if (status != LG_OK && script) (void)unlink(plot->script_path);
    free(plot->picture);
    free(plot->data_path);
    free(plot->script_path);
    return status;
}
