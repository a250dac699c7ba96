/* Arms the calls of a program (faults.h) by its environment:
 *
 *     LG_FAULT=CLASS:WAY:FROM:TO    numbers of fault_class and fault_way; calls FROM to TO
 *     LG_FAULT_COUNT=FILE           gets the numbers of calls of all classes when the program exits
 *
 * A child process continues to count, separately from its parent. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "support/faults.h"

static pid_t own;

__attribute__((constructor)) static void arm(void) {
    const char *text = getenv("LG_FAULT");
    int of, way;
    long from, to;
    own = getpid();
    if (text == NULL || sscanf(text, "%d:%d:%ld:%ld", &of, &way, &from, &to) != 4) return;
    faults_arm((fault_class)of, (fault_way)way, from, to);
}

__attribute__((destructor)) static void count(void) {
    const char *path = getenv("LG_FAULT_COUNT");
    if (path == NULL || getpid() != own) return;
    faults_spare(true);
    FILE *file = fopen(path, "w");
    if (file == NULL) return;
    for (int i = 0; i < FAULT_CLASSES; i++) (void)fprintf(file, "%ld ", faults_calls((fault_class)i));
    (void)fclose(file);
}
