// The group of a lane, and whether a live sample is there. A pass that includes it has PanelGroup, GroupPanel and
// GroupLive, and Counts.
bool is_live(uint lane, out uint group, out uint place)
{
    group = place = 0;
    if (lane >= n_panels * PANEL) return false;
    group = panel_group[lane / PANEL];
    place = lane - group_panel[group].x * PANEL;
    return place < group_live[group];
}
