/* Arms the calls of a program (faults.h) by its environment:
 *
 *     LG_FAULT=CLASS:WAY:FROM:TO       numbers of fault_class and fault_way; calls FROM to TO
 *     LG_FAULT_CHOOSE=CLASS:MOST:FILE  when the program exits, FILE gets the number of calls of the class and
 *                                      the calls that faults_choose chooses
 *
 * A child process continues to count, separately from its parent. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "support/faults.h"

static struct {
    pid_t process;
    int of, path; /* place of the path in the variable */
    long most;
    uint64_t *stacks;
} choice;

enum { ROOM = 1 << 24 }; /* calls whose stacks are noted */

__attribute__((constructor)) static void arm(void) {
    const char *text = getenv("LG_FAULT"), *wanted = getenv("LG_FAULT_CHOOSE");
    int of, way;
    long from, to;
    if (text != NULL && sscanf(text, "%d:%d:%ld:%ld", &of, &way, &from, &to) == 4)
        faults_arm((fault_class)of, (fault_way)way, from, to);
    if (wanted == NULL || sscanf(wanted, "%d:%ld:%n", &choice.of, &choice.most, &choice.path) != 2) return;
    choice.stacks = mmap(NULL, ROOM * sizeof *choice.stacks, PROT_READ | PROT_WRITE,
                         MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (choice.stacks == MAP_FAILED) abort();
    choice.process = getpid();
    faults_note_stacks((fault_class)choice.of, choice.stacks, ROOM);
}

__attribute__((destructor)) static void choose(void) {
    if (choice.process != getpid()) return;
    faults_spare(true);
    const long calls = faults_calls((fault_class)choice.of);
    long *chosen = malloc(((size_t)calls + 1) * sizeof *chosen);
    FILE *file = fopen(getenv("LG_FAULT_CHOOSE") + choice.path, "w");
    if (chosen == NULL || file == NULL) abort();
    const long count = faults_choose(choice.stacks, calls < ROOM ? calls : ROOM, calls, choice.most, chosen);
    (void)fprintf(file, "%ld\n", calls);
    for (long i = 0; i < count; i++) (void)fprintf(file, "%ld\n", chosen[i]);
    (void)fclose(file);
    free(chosen);
}
