// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// A table of many rows, which come as one text: the texts of each row, column by column.
export default {
  template: `
    <table class="plain">
      <thead><tr><th v-for="head in heads" scope="col">{{ head }}</th></tr></thead>
      <tbody>
        <tr v-for="texts in list">
          <td v-for="(text, place) in texts" :data-head="heads[place]">{{ text }}</td>
        </tr>
      </tbody>
    </table>`,
  props: { heads: Array, rows: String },
  computed: {
    list() {
      return JSON.parse(this.rows);
    },
  },
};
