//! The Vision Engine's process: it reads what the others publish and draws it. Nobody waits for it, and it gives way to everybody: it runs
//! as an ordinary process with a lower share of the processor, and draws fewer pixels before it draws fewer pictures.
//!
//! Promise: without a display it goes on headless, without Vulkan without pictures; a stream that makes no sense is left out and counted.

mod adapter;
mod album;
mod display;
mod geometry;
mod hand;
mod instrument;
mod looks;
mod medium;
mod pulse;
mod relay;
mod scenery;
mod sources;
mod strip;
mod switches;
mod touch;
mod vision;

fn main() -> std::process::ExitCode {
    hyst_engine::run(hyst_messages::Role::Rendering, vision::run)
}
