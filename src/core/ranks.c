#include "liegrad/core.h"

#include <stdint.h>
#include <string.h>

#include "core/core.h"

void lg_ranks_part(uint32_t rank, uint32_t count, size_t total, size_t *first, size_t *end) {
    const size_t each = total / count, more = total % count;
    *first = rank * each + rank * more / count;
    *end = (rank + 1) * each + (rank + 1) * more / count;
}

lg_status lg_ranks_share(const lg_ranks *ranks, uint32_t from, void *data, size_t bytes) {
    LG_NEEDS(NULL, ranks, data);
    size_t *list = lg_alloc(NULL, ranks->count, sizeof *list);
    if (list == NULL) return LG_OUT_OF_MEMORY;
    list[from] = bytes;
    const lg_status status = ranks->gather(ranks->user, data, list);
    lg_free(NULL, list);
    return status;
}

lg_status lg_ranks_gather_parts(const lg_ranks *ranks, size_t total, size_t item, void *all) {
    size_t *list = lg_alloc(NULL, ranks->count, sizeof *list);
    if (list == NULL) return LG_OUT_OF_MEMORY;
    for (uint32_t r = 0; r < ranks->count; r++) {
        size_t first, end;
        lg_ranks_part(r, ranks->count, total, &first, &end);
        list[r] = (end - first) * item;
    }
    const lg_status status = ranks->gather(ranks->user, all, list);
    lg_free(NULL, list);
    return status;
}

lg_status lg_ranks_lost(const lg_ranks *ranks, lg_status status, lg_error *error) {
    const char *why = ranks->reason != NULL ? ranks->reason(ranks->user) : NULL;
    return lg_fail(error, status, "%s", why != NULL ? why : "the ranks lost their connection");
}

static lg_status gather_equal(const lg_ranks *ranks, void *all, size_t bytes) {
    return lg_ranks_gather_parts(ranks, ranks->count, bytes, all);
}

lg_status lg_ranks_agree(const lg_ranks *ranks, lg_status status, lg_error *error) {
    LG_NEEDS(error, ranks);
    typedef struct report {
        uint32_t status;
        char message[sizeof error->message];
    } report;
    report *all = lg_alloc(NULL, ranks->count, sizeof *all);
    if (all == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the ranks' reports");
    all[ranks->rank].status = (uint32_t)status;
    if (error != NULL && status != LG_OK)
        memcpy(all[ranks->rank].message, error->message, sizeof error->message);
    lg_status first = gather_equal(ranks, all, sizeof *all);
    if (first != LG_OK) (void)lg_ranks_lost(ranks, first, error);
    for (uint32_t r = 0; r < ranks->count && first == LG_OK; r++) {
        if (all[r].status == LG_OK) continue;
        first = (lg_status)all[r].status;
        (void)lg_fail(error, first, r == ranks->rank ? "%s" : "%s (rank %u)", all[r].message, r);
    }
    lg_free(NULL, all);
    return first;
}
