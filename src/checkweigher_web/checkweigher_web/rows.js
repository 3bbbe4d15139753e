// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Table whose rows are one text in JSON. A cell is a text, or a text and the address of its link. A
// level in the first cell is shown in its colour.
const LEVELS = ["OK", "WARN", "ERROR", "STALE"];

export default {
  template: `
    <table class="plain">
      <thead><tr><th v-for="head in heads" scope="col">{{ head }}</th></tr></thead>
      <tbody>
        <tr v-for="cells in list">
          <td v-for="(cell, place) in cells" :data-head="heads[place]"
              :class="place === 0 ? colour(cell) : ''">
            <a v-if="Array.isArray(cell)" class="nicegui-link" :href="cell[1]">{{ cell[0] }}</a>
            <div v-else-if="cell">{{ cell }}</div>
          </td>
        </tr>
      </tbody>
    </table>`,
  props: { heads: Array, rows: String },
  computed: {
    list() {
      return JSON.parse(this.rows);
    },
  },
  methods: {
    colour(cell) {
      return LEVELS.includes(cell) ? `level-${cell}` : "";
    },
  },
};
