//! What a process was doing when it was found to hang: where its main thread slept, by the kernel's word. It is asked just before the process is ended,
//! for nobody can be asked afterwards.

/// System call of a wait for a word of memory, and the bit in its second argument that says the word is the process's own.
#[cfg(target_arch = "x86_64")]
const FUTEX: u64 = 202;
#[cfg(not(target_arch = "x86_64"))]
const FUTEX: u64 = 98;
const OWN_WORD: u64 = 0x80;

/// What the main thread of a process does, in words; nothing where the kernel does not tell. Reads two short files, neither of which waits for the
/// process's memory map.
pub fn doing(process: u32) -> String {
    let read = |name: &str| std::fs::read_to_string(format!("/proc/{process}/{name}")).unwrap_or_default();
    told(&read("wchan"), &read("syscall"))
}

fn told(channel: &str, call: &str) -> String {
    let (channel, mut words) = (channel.trim(), call.split_whitespace());
    match channel {
        "" | "0" => return if call.trim() == "running" { ", it runs".into() } else { String::new() },
        // The kernel goes on telling the system call that it was stopped in.
        "do_signal_stop" | "ptrace_stop" => return ", it is stopped".into(),
        _ => {}
    }
    let number = words.next().and_then(|number| number.parse::<u64>().ok());
    let what = words.nth(1).and_then(|word| u64::from_str_radix(word.trim_start_matches("0x"), 16).ok());
    match (number, what) {
        (Some(FUTEX), Some(what)) if what & OWN_WORD != 0 => format!(", it sleeps in {channel} for a word of its own"),
        (Some(FUTEX), Some(_)) => format!(", it sleeps in {channel} for a word that it shares"),
        (Some(number), _) => format!(", it sleeps in {channel}, system call {number}"),
        (None, _) => format!(", it sleeps in {channel}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::system;
    use std::process::{Command, Stdio};

    #[test]
    fn a_word_of_its_own_is_told_from_one_that_is_shared_and_what_is_not_told_is_left_out() {
        let futex = |op: u64| format!("{FUTEX} 0x7f9f33300000 {op:#x} 0x2 0x0 0x0 0x0 0x7ffd5d082fc0 0x558e399e5347\n");
        assert_eq!(told("futex_do_wait", &futex(0x80)), ", it sleeps in futex_do_wait for a word of its own");
        assert_eq!(told("futex_do_wait", &futex(0x189)), ", it sleeps in futex_do_wait for a word of its own");
        assert_eq!(told("futex_do_wait", &futex(0x9)), ", it sleeps in futex_do_wait for a word that it shares");
        assert_eq!(told("do_signal_stop", &futex(0x80)), ", it is stopped");
        assert_eq!(told("pipe_write", "1 0x1 0x7f 0x10 0x0 0x0 0x0 0x7ffd 0x55\n"), ", it sleeps in pipe_write, system call 1");
        assert_eq!((told("0", "running\n"), told("", ""), told("0", "")), (", it runs".into(), String::new(), String::new()));
        assert_eq!(
            (told("pipe_read", ""), told("pipe_read", "x y")),
            (", it sleeps in pipe_read".into(), ", it sleeps in pipe_read".into())
        );
    }

    #[test]
    fn of_a_process_that_reads_from_nobody_it_is_said_and_of_one_that_is_gone_nothing() {
        let mut child = Command::new("cat").stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let deadline_ns = system::now_ns() + 20_000_000_000;
        // Whoever may not look, as an ordinary user at some kernels, is told nothing.
        let may_look = std::fs::read_to_string(format!("/proc/{}/syscall", child.id())).is_ok();
        while may_look && !doing(child.id()).contains("read") {
            assert!(system::now_ns() < deadline_ns, "{}", doing(child.id()));
            system::sleep_ns(1_000_000);
        }
        drop(child.stdin.take());
        child.wait().unwrap();
        assert_eq!(doing(child.id()), "");
    }
}
