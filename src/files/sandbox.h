/* Restricts what the child process that reads a foreign file may do. */
#ifndef LG_SANDBOX_H
#define LG_SANDBOX_H

#include <stdbool.h>

/* Restricts this process, which must have a single thread, for the rest of its life. It can read files,
 * compute, and write to `report` and to stderr. It cannot write, create, rename or remove files, open
 * sockets, start programs or processes, or affect other processes: such calls fail with EPERM. Returns false
 * if the system or the build has no such filter. Then only two limits hold: files cannot grow, and the
 * process cannot gain rights. */
bool lg_sandbox_enter(int report);

#endif
