/* Memory of the process. */
#ifndef LG_FILES_MEMORY_H
#define LG_FILES_MEMORY_H

#include <stdint.h>

/* Bytes of address space in use now. Without /proc, a generous guess. */
uint64_t lg_addresses_in_use(void);
/* Bytes that may still be allocated: what the limit on addresses (ulimit -v) leaves or what the system has,
 * whichever is less. UINT64_MAX: unknown. */
uint64_t lg_memory_left(void);

#endif
