/* Restricts what the child process that reads a foreign file may do. */
#ifndef LG_SANDBOX_H
#define LG_SANDBOX_H

/* Restricts this process, which must have a single thread, for the rest of its life. It can read files,
 * compute, and write to `report` and to stderr. It cannot write, create, rename or remove files, open
 * sockets, start programs or processes, or affect other processes: such calls fail with EPERM. Returns NULL
 * on success. If a restriction could not be set, returns its name for the error message. A build without
 * libseccomp cannot filter system calls. It only prevents the process from gaining privileges, and still
 * returns NULL. */
const char *lg_sandbox_enter(int report);

#endif
