// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Table whose rows are one text in JSON. A cell is a text, or a list with a text and the address of
// its link, or a list with a text, the name of the level that colours it, and its language.

export default {
  template: `
    <table class="plain">
      <thead><tr><th v-for="head in heads" scope="col">{{ head }}</th></tr></thead>
      <tbody>
        <tr v-for="cells in list">
          <td v-for="(cell, place) in cells" :data-head="heads[place]"
              :class="isTold(cell) && cell[1] ? 'level-' + cell[1] : ''">
            <a v-if="isLink(cell)" class="nicegui-link" :href="cell[1]">{{ cell[0] }}</a>
            <div v-else-if="isTold(cell)" :lang="cell[2] || null">{{ cell[0] }}</div>
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
    isLink(cell) {
      return Array.isArray(cell) && cell.length === 2;
    },
    isTold(cell) {
      return Array.isArray(cell) && cell.length === 3;
    },
  },
};
