#include "files/memory.h"

#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>

uint64_t lg_addresses_in_use(void) {
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (file != NULL) {
        if (fscanf(file, "%llu", &pages) != 1) pages = 0;
        (void)fclose(file);
    }
    long page = sysconf(_SC_PAGESIZE);
    return pages == 0 || page <= 0 ? (uint64_t)16 << 30 : (uint64_t)pages * (uint64_t)page;
}

uint64_t lg_memory_left(void) {
    unsigned long long kilobytes = 0;
    uint64_t left = UINT64_MAX;
    char line[128];
    struct rlimit limit;
    FILE *file = fopen("/proc/meminfo", "re");
    while (file != NULL && fgets(line, sizeof line, file) != NULL)
        if (sscanf(line, "MemAvailable: %llu kB", &kilobytes) == 1) left = (uint64_t)kilobytes << 10;
    if (file != NULL) (void)fclose(file);
    if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
        const uint64_t used = lg_addresses_in_use(),
                       rest = limit.rlim_cur > used ? (uint64_t)limit.rlim_cur - used : 0;
        if (rest < left) left = rest;
    }
    return left;
}
