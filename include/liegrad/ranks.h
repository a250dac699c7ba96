/* Processes that compute one result together: ranks, numbered from 0. The library asks for two exchanges, and
 * liegrad_mpi (liegrad/mpi.h) has them over MPI; a caller may give its own.
 *
 * Every rank calls the same functions in the same order with the same arguments (options, data, callbacks
 * that return the same). Each then has the same result, with the bits of one process: pieces of work are
 * divided as recorded, whatever the number of ranks, and are summed in their order on every rank. That needs
 * processors of one type, since kernels and BLAS are chosen by it.
 */
#ifndef LIEGRAD_RANKS_H
#define LIEGRAD_RANKS_H

#include <stddef.h>
#include <stdint.h>

#include "liegrad/export.h"
#include "liegrad/status.h"

LG_BEGIN_DECLS

typedef struct lg_ranks {
    size_t size; /* sizeof(lg_ranks) */
    uint32_t rank, count;
    void *user;
    /* all: bytes[0] + ... + bytes[count - 1] bytes, those of rank r behind those of the ranks before it. The
     * caller's own are in place; the others' are filled in. Collective. */
    lg_status (*gather)(void *user, void *all, const size_t *bytes);
    /* The same, but only rank 0 receives, in `all`; `mine` are the caller's own bytes. `all` is not read on
     * other ranks and may be NULL there. Collective. */
    lg_status (*collect)(void *user, const void *mine, void *all, const size_t *bytes);
} lg_ranks;

/* Part `rank` of `count` of 0..total-1: first and one behind the last; differs by one item at most. */
LG_API void lg_ranks_part(uint32_t rank, uint32_t count, size_t total, size_t *first, size_t *end);
/* `data` of rank `from` on all ranks. */
LG_API lg_status lg_ranks_share(const lg_ranks *ranks, uint32_t from, void *data, size_t bytes);
/* The first failure by number of rank, with its sentence, on all ranks; LG_OK where there is none. */
LG_API lg_status lg_ranks_agree(const lg_ranks *ranks, lg_status status, lg_error *error);

LG_END_DECLS

#endif
