/* Ranks of MPI: link liegrad_mpi beside liegrad.
 *
 *   lg_ranks ranks;
 *   MPI_Init(&argc, &argv);
 *   lg_status status = lg_mpi_ranks(NULL, &ranks, &error);
 *   options.ranks = &ranks;                              of lg_fit_options
 *   ...
 *   lg_mpi_release(&ranks);
 *   MPI_Finalize();
 *
 * Exchanges are MPI_Allgatherv and MPI_Gatherv of bytes on the thread that calls the library
 * (MPI_THREAD_FUNNELED is enough). No sum is MPI's own: those depend on the number of ranks.
 */
#ifndef LIEGRAD_MPI_H
#define LIEGRAD_MPI_H

#include "liegrad/ranks.h"

LG_BEGIN_DECLS

/* The ranks of a communicator, which is duplicated; `communicator` points to an MPI_Comm, NULL:
 * MPI_COMM_WORLD. MPI must have been initialised. Collective. Ranks whose processors take other kernels, or
 * that run another version of the library, are refused on all, since bits would differ. Errors:
 * LG_INVALID_ARGUMENT, LG_OUT_OF_MEMORY. */
LG_API lg_status lg_mpi_ranks(const void *communicator, lg_ranks *out, lg_error *error);
LG_API void lg_mpi_release(lg_ranks *ranks); /* what lg_mpi_ranks made; collective */

/* For programs that do not call MPI themselves: MPI_Init, where that has not been done, and lg_mpi_ranks of
 * all. */
LG_API lg_status lg_mpi_begin(lg_ranks *out, lg_error *error);
/* Releases; MPI_Finalize, which waits for all ranks, where lg_mpi_begin initialised. */
LG_API void lg_mpi_end(lg_ranks *ranks);
/* Ends all ranks now, with this exit code. */
LG_API void lg_mpi_abort(int code);

LG_END_DECLS

#endif
