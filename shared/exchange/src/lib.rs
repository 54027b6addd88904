//! How engines exchange data across process borders: station pages (cells, rings, waitable words), streams (iceoryx2, loaned in
//! place), rendezvous, meeting point, files that are replaced as a whole, and the usher that keeps connecting off the real-time
//! threads. After Tuchschmid et al., "A Flexible Framework for Highly-Modular Surgical Simulation Systems" (ISBMS 2006), carried across processes.
//!
//! This is the only crate that names iceoryx2, and the only one with `unsafe`: in [`page`], [`system`], [`latch`],
//! [`allocation`] and `loan`.

pub mod allocation;
pub mod cell;
pub mod checkpoint;
pub mod cores;
pub mod latch;
mod loan;
pub mod locking;
pub mod machine;
pub mod mappings;
pub mod meeting;
pub mod page;
pub mod rendezvous;
pub mod roster;
pub mod rounds;
pub mod stall;
pub mod station;
pub mod stream;
pub mod succession;
pub mod synchronized;
pub mod system;
pub mod usher;
pub mod whole;

pub use loan::Loan;
pub use page::{Access, OwnedPage, PageError, ReadPage};
pub use roster::{Horizon, Roster, Tenure};
pub use rounds::Rounds;
pub use station::{Station, StationError, StationPage};
pub use stream::{Held, LinkError, Links, Publisher, Subscriber};
