//! The life latch: some words of a process's own page that the kernel marks when the thread that holds them dies, whatever it dies of.
//!
//! It is a robust mutex of the C library. Each thread gives the kernel a list of those that it holds (`set_robust_list(2)`), and they are marked as its
//! first act of dying. A pidfd tells of a death only when the last thread of the process has come by a core, and has given back the memory: that took 41 ms
//! in the median where two cores are full (2-core VM, 2026-11-22).
//!
//! Promise: the latch of a thread that lives is never open; that of one that has died is, once it was held.

use std::sync::atomic::AtomicU64;

/// 64-bit words of a latch.
pub const WORDS: usize = 8;
const _: () = assert!(size_of::<libc::pthread_mutex_t>() <= 8 * WORDS);
/// What the kernel sets in the word of the lock (`FUTEX_OWNER_DIED` of linux/futex.h). In which half of the first 64 bits that word lies is the C library's
/// affair; the other half never has this bit.
const OWNER_DIED: u32 = 0x4000_0000;

/// Makes the latch and holds it for as long as the calling thread lives. False where the C library refuses. The words have to stay mapped as long.
#[allow(unsafe_code)]
pub fn hold(words: &[AtomicU64; WORDS]) -> bool {
    let mutex = words.as_ptr().cast_mut().cast::<libc::pthread_mutex_t>();
    let mut attributes = std::mem::MaybeUninit::<libc::pthread_mutexattr_t>::uninit();
    let attributes = attributes.as_mut_ptr();
    // SAFETY: `attributes` is initialized by the first call and destroyed by the last. The mutex lies in the words, which are large enough for it (asserted
    // above) and aligned to 8 bytes, as it asks; they are atomics, so they may be written through a shared reference, and nobody but this function and the
    // kernel does. It is made here, before anybody locks it, and never unlocked, so that no second thread is ever let in.
    unsafe {
        if libc::pthread_mutexattr_init(attributes) != 0 {
            return false;
        }
        let held = libc::pthread_mutexattr_setrobust(attributes, libc::PTHREAD_MUTEX_ROBUST) == 0
            && libc::pthread_mutexattr_setpshared(attributes, libc::PTHREAD_PROCESS_SHARED) == 0
            && libc::pthread_mutex_init(mutex, attributes) == 0
            && libc::pthread_mutex_lock(mutex) == 0;
        libc::pthread_mutexattr_destroy(attributes);
        held
    }
}

/// Whether the first word of a latch says that its holder has died.
pub fn is_open(word: u64) -> bool {
    word as u32 & OWNER_DIED != 0 || (word >> 32) as u32 & OWNER_DIED != 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering;
    use std::sync::mpsc::channel;

    #[test]
    fn a_latch_opens_when_its_holder_ends_and_not_before() {
        let words: &'static [AtomicU64; WORDS] = Box::leak(Box::default());
        let open = || is_open(words[0].load(Ordering::Acquire));
        assert!(!open(), "nobody has held it");
        let (done, wait) = channel::<()>();
        let (held, was_held) = channel();
        let holder = std::thread::spawn(move || {
            held.send(hold(words)).unwrap();
            wait.recv().unwrap_err()
        });
        assert!(was_held.recv().unwrap());
        assert!(!open() && words[0].load(Ordering::Acquire) != 0, "its holder lives");
        drop(done);
        holder.join().unwrap();
        assert!(open());
        // A successor in the same place makes it anew.
        let again = std::thread::spawn(move || (hold(words), is_open(words[0].load(Ordering::Acquire)))).join().unwrap();
        assert_eq!((again, open()), ((true, false), true));
    }
}
