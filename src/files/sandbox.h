/* What the child that reads a foreign file may still do. */
#ifndef LG_SANDBOX_H
#define LG_SANDBOX_H

#include <stdbool.h>

/* From now on this process, which has one thread, can read files, compute, and write to `report` and to
 * stderr. It cannot write, make, rename or remove files, open sockets, start programs or processes, or reach
 * other processes: the system answers EPERM. There is no way back. False: the system or the build has no such
 * filter, and nothing has changed but that files cannot grow and that no rights are won. */
bool lg_sandbox_enter(int report);

#endif
