/* Words that two processes share: written with release, read with acquire. */
#ifndef MIDDECK_WORDS_H
#define MIDDECK_WORDS_H

#define word_get(p) __atomic_load_n((p), __ATOMIC_ACQUIRE)
#define word_set(p, value) __atomic_store_n((p), (value), __ATOMIC_RELEASE)

/* What the word stands for is about to change: nothing of it is written before the zero. */
#define word_open(p)                                  \
    do {                                              \
        __atomic_store_n((p), 0, __ATOMIC_RELAXED);   \
        __atomic_thread_fence(__ATOMIC_RELEASE);      \
    } while (0)

#endif
