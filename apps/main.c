/* The executable `liegrad`, which has all programs but lg-bench and lg-gradcheck. The programs' names are
 * links to it. The name by which it is started chooses the program; if that is no program's name, the first
 * argument does (`liegrad lg-fit ...`). */
#include <stdio.h>
#include <string.h>

#include "common/app.h"

/* LIEGRAD_PROGRAMS is X(lg_anomaly) X(lg_control) ... */
#define X(name) int name##_main(int argc, char **argv);
LIEGRAD_PROGRAMS
#undef X

typedef struct program {
    const char *symbol;
    int (*run)(int argc, char **argv);
} program;
static const program programs[] = {
#define X(name) {#name, name##_main},
    LIEGRAD_PROGRAMS
#undef X
};

/* Returns whether the path ends in the program's name, lg-x for the symbol lg_x. */
static bool is_named(const char *path, const char *symbol) {
    const char *slash = strrchr(path, '/'), *name = slash == NULL ? path : slash + 1;
    while (*name != '\0' && *symbol == (*name == '-' ? '_' : *name)) name++, symbol++;
    return *name == '\0' && *symbol == '\0';
}

int main(int argc, char **argv) {
    for (int word = 0; word < argc && word < 2; word++)
        for (size_t i = 0; i < LG_COUNT(programs); i++)
            if (is_named(argv[word], programs[i].symbol)) return programs[i].run(argc - word, argv + word);
    if (LG_COUNT(programs) == 1) return programs[0].run(argc, argv); /* a program of a user has any name */
    (void)fputs("liegrad: the first argument must be a program, one of", stderr);
    for (size_t i = 0; i < LG_COUNT(programs); i++)
        (void)fprintf(stderr, " lg-%s", programs[i].symbol + sizeof "lg-" - 1);
    (void)fputs("\n", stderr);
    return APP_EXIT_USAGE;
}
