#include "pictures.h"

#include <errno.h>
#include <math.h>
#include <spawn.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

extern char **environ;

enum { PATH = 1024, DECADE_BINS = 10, DECADES = 7 }; /* bins from 10 ns to 100 ms */

static FILE *open_in(const char *folder, const char *name) {
    char path[PATH];
    FILE *stream = NULL;
    if (snprintf(path, sizeof path, "%s/%s", folder, name) < PATH) stream = fopen(path, "w");
    if (stream == NULL) (void)fprintf(stderr, "%s/%s cannot be written: %s\n", folder, name, strerror(errno));
    return stream;
}

static bool close_whole(FILE *stream) {
    const bool whole = ferror(stream) == 0;
    return fclose(stream) == 0 && whole;
}

/* Writes gnuplot's command `cd` into `command` (2 PATH + 8 bytes). Inside single quotes only the quote itself
 * is special; it is doubled. open_in has checked that the folder is shorter than PATH. */
static void change_folder(const char *folder, char *command) {
    size_t used = (size_t)sprintf(command, "cd '");
    for (const char *c = folder; *c != '\0'; c++) {
        if (*c == '\'') command[used++] = '\'';
        command[used++] = *c;
    }
    (void)strcpy(command + used, "'");
}

/* Writes the script NAME.gp, whose file names are relative to the folder, and runs it with gnuplot. */
static bool draw_by_script(const char *folder, const char *name, int height, const char *commands) {
    char file[PATH], change[2 * PATH + 8], load[PATH];
    (void)snprintf(file, sizeof file, "%s.gp", name);
    FILE *script = open_in(folder, file);
    if (script == NULL) return false;
    (void)fprintf(script,
                  "set terminal svg size 900,%d dynamic background rgb 'white' font 'Helvetica,13'\n"
                  "set output '%s.svg'\nset grid lc rgb '#dddddd'\nset border lc rgb '#555555'\n%s",
                  height, name, commands);
    if (!close_whole(script)) return false;
    change_folder(folder, change);
    (void)snprintf(load, sizeof load, "load '%s.gp'", name);
    char *const arguments[] = {"gnuplot", "-e", change, "-e", load, NULL};
    pid_t child;
    int status = 127 << 8;
    if (posix_spawnp(&child, "gnuplot", NULL, NULL, arguments, environ) == 0)
        while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
        }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        (void)fprintf(stderr, "gnuplot did not draw %s.svg; %s/%s.gp and %s.dat are there\n", name, folder,
                      name, name);
    return true;
}

bool picture_energy(const char *folder, const trace *record, double target, double tolerance) {
    char commands[2048];
    FILE *data = open_in(folder, "energy.dat");
    if (data == NULL) return false;
    (void)fputs("# t learned_energy energy angle torque\n", data);
    for (size_t i = 0; i < record->count; i++) {
        const trace_row *row = record->rows + i;
        (void)fprintf(data, "%.9g %.9g %.9g %.9g %.9g\n", row->t, row->learned - target, row->energy,
                      row->angle, row->torque);
    }
    if (!close_whole(data)) return false;
    (void)snprintf(commands, sizeof commands,
                   "set multiplot layout 3,1\nset lmargin 10\nset rmargin 3\nset key bottom right\n"
                   "set ylabel 'energy / mgL'\n"
                   "plot 1 lc rgb '#999999' dt 2 title 'upright at rest', "
                   "'energy.dat' using 1:3 with lines lw 3 lc rgb '#7fb3d5' title 'true H', "
                   "'' using 1:($2+1) with lines lw 1 lc rgb '#922b21' title 'learned H'\n"
                   "set ylabel 'torque / mgL'\nset yrange [0:*]\nset offsets 0, 0, 0.02, 0\n"
                   "plot 'energy.dat' using 1:5 with lines lc rgb '#1e8449' title '|torque|'\n"
                   "unset offsets\nset key top right\nset ylabel 'angle to the vertical / rad'\nset xlabel "
                   "'t / s'\nset logscale y\n"
                   "set yrange [*:10]\nset format y '10^{%%L}'\n"
                   "plot %g lc rgb '#999999' dt 2 title 'bound in the last seconds', "
                   "'energy.dat' using 1:4 with lines lw 2 lc rgb '#922b21' title 'angle'\nunset multiplot\n",
                   tolerance);
    return draw_by_script(folder, "energy", 760, commands);
}

/* Fraction of the samples in each bin. A bin is a tenth of a decade wide; the first one begins at 10 ns.
 * Samples outside count in the outermost bins. */
static void bin(const samples *from, double *fraction) {
    for (int i = 0; i < DECADES * DECADE_BINS; i++) fraction[i] = 0.0;
    for (size_t i = 0; i < from->count; i++) {
        const double at = from->ns[i] > 10 ? floor(DECADE_BINS * (log10((double)from->ns[i]) - 1.0)) : 0.0;
        fraction[(int)fmin(at, DECADES * DECADE_BINS - 1)] += 1.0 / (double)from->count;
    }
}

bool picture_latency(const char *folder, const histogram_series *series, int count) {
    enum { COLOURS = 5 };
    static const char *const colours[COLOURS] = {"#922b21", "#d68910", "#999999", "#7fb3d5", "#1e8449"};
    char commands[2048];
    size_t used = (size_t)snprintf(
        commands, sizeof commands,
        "set logscale xy\nset key outside bottom center horizontal\nset xlabel 'us'\nset ylabel "
        "'fraction of the steps in a tenth of a decade'\nset xrange [0.01:1e5]\nset yrange [1e-6:1]\n"
        "set format y '10^{%%L}'\nplot ");
    FILE *data = open_in(folder, "latency.dat");
    if (data == NULL) return false;
    for (int s = 0; s < count; s++) {
        double fraction[DECADES * DECADE_BINS];
        bin(series[s].from, fraction);
        (void)fprintf(data, "# %s: left end of the bin in us, fraction\n", series[s].title);
        for (int i = 0; i < DECADES * DECADE_BINS; i++)
            (void)fprintf(data, "%.6g %.6g\n", 1e-2 * pow(10.0, (double)i / DECADE_BINS),
                          fmax(fraction[i], 1e-9));
        (void)fprintf(data, "%.6g %.6g\n", 1e-2 * pow(10.0, DECADES), 1e-9);
        (void)fputs("\n\n", data);
        used += (size_t)snprintf(commands + used, sizeof commands - used,
                                 "%s'latency.dat' index %d using 1:2 with steps lw 2 lc rgb '%s' title '%s'",
                                 s > 0 ? ", " : "", s, colours[s % COLOURS], series[s].title);
        if (used >= sizeof commands) return fclose(data) == 0 && false;
    }
    (void)snprintf(commands + used, sizeof commands - used, "\n");
    return close_whole(data) && draw_by_script(folder, "latency", 480, commands);
}
