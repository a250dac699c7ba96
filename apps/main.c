/* The executable `liegrad`, which has all programs but lg-bench and lg-gradcheck. The programs' names are
 * links to it. The name by which it is started chooses the program. If this is not the name of a program, the
 * first argument chooses it: `liegrad lg-fit train ...` or `liegrad fit train ...`. */
#include <string.h>

#include "common/app.h"

/* LIEGRAD_PROGRAMS is X("lg-anomaly", lg_anomaly) X("lg-control", lg_control) ... */
#define X(name, symbol) int symbol##_main(int argc, char **argv);
LIEGRAD_PROGRAMS
#undef X

static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
} programs[] = {
#define X(name, symbol) {name, symbol##_main},
    LIEGRAD_PROGRAMS
#undef X
};

/* Returns whether the last part of the path is `name`. */
static bool is_named(const char *path, const char *name) {
    return strcmp(app_name_of(path), name) == 0;
}

int main(int argc, char **argv) {
    for (int word = 0; word < argc && word < 2; word++)
        for (size_t i = 0; i < LG_COUNT(programs); i++)
            if (is_named(argv[word], programs[i].name) ||
                (word == 1 && strcmp(argv[1], programs[i].name + strlen("lg-")) == 0))
                return programs[i].run(argc - word, argv + word);
    const bool asked = argc > 1 && is_named(argv[0], "liegrad") &&
                       (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "--version") == 0);
    FILE *stream = asked ? stdout : stderr;
    (void)fprintf(stream, "liegrad %s: the first argument must be a program, one of", lg_version());
    for (size_t i = 0; i < LG_COUNT(programs); i++) (void)fprintf(stream, " %s", programs[i].name);
    (void)fputs("\n", stream);
    return asked ? APP_EXIT_OK : APP_EXIT_USAGE;
}
