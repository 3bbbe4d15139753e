// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// List of items, recipes or users. Its rows are one text, which the server makes once for all
// viewers. A row contains a key, an item number, a decision, and the texts of the other columns. In
// lists of recipes and users, it contains a name instead of the number, and an empty decision. The
// Tab key enters the list at one row, and the arrow keys move between the rows.
export default {
  template: `
    <table class="plain">
      <thead><tr><th v-for="head in heads" scope="col">{{ head }}</th></tr></thead>
      <tbody>
        <tr v-for="[key, number, decision, ...texts] in list" :key="key"
            :class="[decision, { chosen: key === chosen }]">
          <td>
            <button :aria-label="verb + ' ' + number" :aria-pressed="key === chosen"
                    :tabindex="key === stop ? 0 : -1" @keydown.up.prevent="step(-1)"
                    @keydown.down.prevent="step(1)" @keydown.home.prevent="step(-Infinity)"
                    @keydown.end.prevent="step(Infinity)"
                    @click="$emit('choose', key)">{{ number }}</button>
          </td>
          <td v-for="text in texts">{{ text }}</td>
        </tr>
      </tbody>
    </table>`,
  props: { heads: Array, rows: { type: String, default: "[]" }, chosen: String,
           verb: String },
  emits: ["choose"],
  computed: {
    list() {
      return JSON.parse(this.rows);
    },
    // The Tab key leads to the chosen row, or to the first row.
    stop() {
      return (this.list.find(row => row[0] === this.chosen) ?? this.list[0])?.[0];
    },
  },
  methods: {
    step(by) {
      const buttons = [...this.$el.querySelectorAll("button")];
      const place = buttons.indexOf(document.activeElement) + by;
      buttons[Math.min(Math.max(place, 0), buttons.length - 1)]?.focus();
    },
  },
};
