//! A driver in C that asks for real time is tied to a core that it may use, as the station's own processes are.

use super::compile;
use super::window::Empty;
use station_tests::Folder;
use station_tests::shown::not_shown;
use std::path::Path;

/// A driver that says on which cores it may run once it has asked for real time.
const SOURCE: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(int argc, char **argv) {
    static hyst_driver driver;
    cpu_set_t cores;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    hyst_real_time(&driver);
    if (sched_getaffinity(0, sizeof cores, &cores) != 0) return hyst_fail(&driver, 1, "the kernel does not say its cores");
    for (int core = 0; core < CPU_SETSIZE; core++)
        if (CPU_ISSET(core, &cores)) printf("%d ", core);
    return hyst_end(&driver);
}
"#;

/// It was tied to core 0, also where it was to keep off it.
#[test]
fn a_driver_in_c_is_tied_to_the_first_of_the_cores_that_it_may_use() {
    let status = std::fs::read_to_string("/proc/self/status").expect("what the kernel says of this process");
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")).expect("its cores").trim();
    let ends: Vec<&str> = list.split([',', '-']).collect();
    let [first, .., last] = ends[..] else {
        return not_shown("which core a driver is tied to: there is one");
    };
    let folder = Folder::new("driver-cores");
    let program = compile(&folder, "cores", Path::new(&folder.write("cores.c", SOURCE)), &[]);
    let mut empty = Empty::new("cores");
    let mut cores = |wrapper: &[&str]| {
        let (code, out, said) = empty.run_under(wrapper, &program);
        assert_eq!(code, Some(0), "{wrapper:?}: {said}");
        out.trim().to_string()
    };
    assert_eq!([cores(&[]), cores(&["taskset", "-c", last])], [first, last]);
}
