/* Ranks of MPI: link liegrad_mpi beside liegrad.
 *
 *   lg_ranks ranks;
 *   lg_status status = lg_mpi_begin(NULL, &ranks, &error);
 *   options.ranks = &ranks;                              of lg_fit_options
 *   ...
 *   lg_mpi_end(&ranks);
 *
 * Exchanges are MPI_Allgatherv and MPI_Gatherv of bytes on the thread that calls the library
 * (MPI_THREAD_FUNNELED is enough). No sum is MPI's own: those depend on the number of ranks.
 */
#ifndef LIEGRAD_MPI_H
#define LIEGRAD_MPI_H

#include "liegrad/ranks.h"

LG_BEGIN_DECLS

/* The ranks of a communicator, which is duplicated; `communicator` points to an MPI_Comm. NULL:
 * MPI_COMM_WORLD, and MPI_Init first where that has not been done. Collective. Ranks whose processors take
 * other kernels, or that run another version of the library, are refused on all, since bits would differ.
 * Errors: LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY, LG_FILE (MPI does not start). */
LG_API lg_status lg_mpi_begin(const void *communicator, lg_ranks *out, lg_error *error);
/* Releases; MPI_Finalize, which waits for all ranks, where lg_mpi_begin initialised. Collective. */
LG_API void lg_mpi_end(lg_ranks *ranks);
/* Ends all ranks now, with this exit code. */
LG_API void lg_mpi_abort(int code);

LG_END_DECLS

#endif
