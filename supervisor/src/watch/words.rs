//! What the thread says of those whom it watches in words of the station page, for which spares and ushers wait.

use super::Ward;
use hyst_exchange::OwnedPage;
use hyst_messages::page::station as layout;

/// Says that one is dead, if it is still the one in its slot.
pub(super) fn mark_dead(page: &OwnedPage, ward: &Ward) {
    let at = ward.slot.number();
    if page.load32(layout::SLOT_INCARNATION + at) == ward.incarnation {
        page.store32(layout::SLOT_DEAD + at, 1);
        page.bump_and_wake(layout::CHANGES);
    }
}

/// Takes back that one is dead who lives, as a flipped bit says; gives whether it had to. Nobody but this thread says so of whom it watches, and a slot is filled
/// again only when its last process has ended.
pub(super) fn take_back_death(page: &OwnedPage, ward: &Ward) -> bool {
    let word = layout::SLOT_DEAD + ward.slot.number();
    let is_said = page.load32(word) != 0;
    if is_said {
        page.store32(word, 0);
        page.bump_and_wake(layout::CHANGES);
    }
    is_said
}

/// A spare waits for this word before it takes the role from one that lives.
pub(super) fn mark_suspect(page: &OwnedPage, ward: &Ward, suspected: bool) {
    page.store32(layout::SLOT_SUSPECT + ward.slot.number(), if suspected { ward.incarnation } else { 0 });
}
