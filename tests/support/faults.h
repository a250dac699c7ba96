/* Calls of the C library that fail on request, to see what the project makes of it.
 *
 * The code under test calls __wrap_NAME in place of NAME: the suites are linked with copies of the static
 * libraries in which the names are replaced (liegrad_faulty in tests/CMakeLists.txt; the calls of the tests
 * themselves stay as they are), the programs in the folder `faulty` with the linker's --wrap. The names and
 * their classes are the table in faults.c. Calls are counted over all threads, from 1. */
#ifndef LG_FAULTS_H
#define LG_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

/* MEMORY: what allocates, and what starts a thread or a process. FILES: what opens, reads, writes, locks,
 * names or closes a file. */
typedef enum fault_class { FAULT_MEMORY, FAULT_FILES, FAULT_CLASSES } fault_class;

/* FAIL: nothing happens, and the call returns an error; close and fclose close and return an error.
 * SHORT: read and write do half of the bytes, other calls are not touched. INTERRUPT: EINTR, where a call may
 * return it. */
typedef enum fault_way { FAULT_FAIL, FAULT_SHORT, FAULT_INTERRUPT } fault_way;

/* Makes calls `from` to `to` of the class fail and starts to count. from = 0: no call fails. */
void faults_arm(fault_class of, fault_way way, long from, long to);

/* No further call fails; the counts stay. */
void faults_disarm(void);

/* Whether the calling thread's next calls work and are not counted. */
void faults_spare(bool spared);

/* Calls of the class since faults_arm, and whether one of them was made to fail. */
long faults_calls(fault_class of);
bool faults_hit(void);

/* Blocks that were allocated by calls of the table and are not freed. */
long faults_live(void);

/* From now on the stacks of the first `room` calls of the class are noted as hashes of their innermost
 * frames. NULL ends it. */
void faults_note_stacks(fault_class of, uint64_t *stacks, long room);

#endif
