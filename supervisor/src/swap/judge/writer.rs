//! Whose a state is. The stream that it was read from says so, for it has one writer; the header says what its writer likes. A newcomer that named the old engine
//! was compared with nobody, and one that sent states under both names with itself.

use super::Pairs;
use hyst_messages::{Kind, Message};

impl Pairs {
    /// Takes what was read from a writer's stream. A state of the newcomer's that names another writer is out of tolerance. One of an elder's that does is
    /// compared with nothing: its bytes may have flipped.
    pub(super) fn hear(&mut self, kind: Kind, bytes: &[u8], writer: u32, guest: u32) {
        let Ok(named) = Message::parse(bytes, kind).map(|message| message.header().incarnation) else { return };
        if named == writer {
            self.take(kind, bytes, guest);
        } else if writer == guest {
            let own = format!("its own, which is {guest} (`incarnation` of the header)");
            self.seen.note((f64::INFINITY, format!("its state names another incarnation, {named}, than {own}")));
        }
    }
}
