/* How many elements an array has; `array` is no pointer. */
#ifndef LG_CORE_COUNT_H
#define LG_CORE_COUNT_H

#define LG_COUNT(array) (sizeof(array) / sizeof((array)[0]))

#endif
