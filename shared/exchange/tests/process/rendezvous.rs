//! The Rendezvous between processes when client or server is killed or stands.

use crate::support::*;
use hyst_exchange::rendezvous::{Client, ProcessClient, RendezvousError, Server};
use hyst_exchange::{Links, Station, system};
use hyst_messages::{Kind, Role};

const KIND: Kind = Kind::Appearance;
/// The deadline of a client whose server is not expected to answer, ns.
const SHORT_NS: u64 = 20_000_000;

fn join(station: &Station) -> Links {
    Links::join(station, "test").unwrap()
}

/// What the partner answers.
fn answer(request: &[u8], incarnation: u32) -> Vec<u8> {
    request.iter().rev().copied().chain(incarnation.to_le_bytes()).collect()
}

/// Waits for the answer to the request that was begun, until a deadline.
fn await_answer(client: &mut ProcessClient, deadline_ns: u64) -> Result<Vec<u8>, RendezvousError> {
    loop {
        if let Some(answer) = client.poll()? {
            return Ok(answer);
        }
        if system::now_ns() >= deadline_ns {
            return Err(RendezvousError::TimedOut);
        }
        std::thread::yield_now();
    }
}

#[test]
fn a_server_killed_at_any_point_gives_a_typed_answer_and_its_successor_never_saw_the_request() {
    isolated(a_server_killed_at_any_point_gives_a_typed_answer_and_its_successor_never_saw_the_request, |station| {
        let links = join(station);
        let points = ["kill@before-request", "kill@before-receive", "kill@in-answer", "abort@in-answer", "kill@after-answer"];
        for (incarnation, fate) in (1..).step_by(2).zip(points) {
            let service = links.create_rendezvous(Role::Tissue, incarnation, KIND).unwrap();
            let mut server = Partner::start(station, "serve", incarnation, fate, 0);
            server.expect("open");
            let mut client = links.client(Role::Tissue, incarnation, KIND).unwrap();
            if fate == "kill@before-request" {
                server.kill();
            }
            let begun = client.begin(b"old");
            server.tell("once");
            server.kill_or_await(fate);
            let outcome = begun.and_then(|()| await_answer(&mut client, system::now_ns() + SHORT_NS));
            if fate == "kill@after-answer" {
                assert_eq!(outcome, Ok(answer(b"old", incarnation)), "an answer outlives its server");
            } else {
                assert!(matches!(outcome, Err(RendezvousError::TimedOut | RendezvousError::ServerGone)), "{fate}: {outcome:?}");
            }
            links.clean_up_dead();
            let again = client.ask(b"again", system::now_ns() + SHORT_NS);
            assert!(matches!(again, Err(RendezvousError::TimedOut | RendezvousError::ServerGone)), "{fate}: {again:?}");
            drop((client, service));

            let next = incarnation + 1;
            let _service = links.create_rendezvous(Role::Tissue, next, KIND).unwrap();
            let mut server = Partner::start(station, "serve", next, "live", 0);
            server.expect("open");
            server.tell("once");
            server.expect("served 0");
            let mut client = links.client(Role::Tissue, next, KIND).unwrap();
            client.begin(b"new").unwrap();
            server.tell("wait");
            assert_eq!(await_answer(&mut client, far_ns()), Ok(answer(b"new", next)));
            server.expect("served 1");
        }
    });
}

#[test]
fn a_server_that_stands_costs_the_client_its_deadline_each_time_and_late_answers_are_not_taken() {
    isolated(a_server_that_stands_costs_the_client_its_deadline_each_time_and_late_answers_are_not_taken, |station| {
        let links = join(station);
        for (incarnation, fate) in [(1, "stop@before-receive"), (2, "stop@in-answer")] {
            let _service = links.create_rendezvous(Role::Tissue, incarnation, KIND).unwrap();
            let mut server = Partner::start(station, "serve", incarnation, fate, 0);
            server.expect("open");
            let mut client = links.client(Role::Tissue, incarnation, KIND).unwrap();
            client.begin(&[0]).unwrap();
            server.tell("wait");
            server.await_stop();
            for request in 1..20 {
                let outcome = client.ask(&[request], system::now_ns() + SHORT_NS / 10);
                assert_eq!(outcome, Err(RendezvousError::TimedOut), "{fate}: request {request}");
            }
            client.begin(&[99]).unwrap();
            server.go_on();
            server.hear();
            // What is left of the old requests is served or dropped, then the present one is.
            for _ in 0..3 {
                server.tell("once");
                server.hear();
            }
            assert_eq!(await_answer(&mut client, far_ns()), Ok(answer(&[99], incarnation)), "{fate}");
            assert_eq!(client.poll(), Ok(None));
        }
    });
}

#[test]
fn clients_killed_at_any_point_cost_the_server_nothing() {
    isolated(clients_killed_at_any_point_cost_the_server_nothing, |station| {
        let links = join(station);
        let _service = links.create_rendezvous(Role::Tissue, 1, KIND).unwrap();
        let mut server = links.server(Role::Tissue, 1, KIND).unwrap();
        let mut other = links.client(Role::Tissue, 1, KIND).unwrap();
        let points = ["kill@before-request", "kill@after-request", "abort@after-request", "kill@after-answer"];
        // More clients than the service has places, so that the places of the dead must be had back.
        for (incarnation, fate) in (10..30).zip(points.iter().cycle()) {
            let mut client = Partner::start(station, "ask", incarnation, fate, 1);
            client.expect("open");
            client.tell("ask");
            let asked = *fate != "kill@before-request";
            if asked {
                client.expect("asked");
            }
            if *fate != "kill@after-answer" {
                client.await_death();
            }
            if asked {
                let served = server.serve_until(far_ns(), &mut |request| request.to_vec());
                assert!(matches!(served, Ok(0 | 1)), "{fate}: {served:?}");
            }
            if *fate == "kill@after-answer" {
                client.await_death();
            }
            other.begin(b"mine").unwrap();
            until(|| (server.serve(&mut |request| answer(request, 7)).unwrap() > 0).then_some(()));
            assert_eq!(await_answer(&mut other, far_ns()), Ok(answer(b"mine", 7)), "{fate}");
            links.clean_up_dead();
        }
    });
}

#[test]
fn a_client_that_stands_neither_blocks_the_server_nor_loses_its_answer() {
    isolated(a_client_that_stands_neither_blocks_the_server_nor_loses_its_answer, |station| {
        let links = join(station);
        let _service = links.create_rendezvous(Role::Tissue, 1, KIND).unwrap();
        let mut server = links.server(Role::Tissue, 1, KIND).unwrap();
        let mut other = links.client(Role::Tissue, 1, KIND).unwrap();
        let mut client = Partner::start(station, "ask", 2, "stop@after-request", 1);
        client.expect("open");
        client.tell("ask");
        client.expect("asked");
        client.await_stop();
        for round in 0..50u8 {
            other.begin(&[round]).unwrap();
            until(|| (server.serve(&mut |request| request.to_vec()).unwrap() > 0).then_some(()));
            let got = until(|| {
                server.serve(&mut |request| request.to_vec()).unwrap();
                other.poll().unwrap()
            });
            assert_eq!(got, [round]);
        }
        client.go_on();
        client.expect("answer 5");
    });
}
